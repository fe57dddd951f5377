$(eval $(call test,tests/accuracy/test_pace.c,$(call objects,apps/studies/accuracy/study_pace.c) $(LIBAPP_A),))
$(eval $(call test,tests/accuracy/test_limit.c,$(call objects,apps/studies/accuracy/study_time.c) $(LIBAPP_A) $(SIM_LIBS),-lyaml -lcjson))
