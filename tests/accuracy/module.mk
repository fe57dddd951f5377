$(eval $(call test,tests/accuracy/test_pace.c,$(call objects,apps/studies/accuracy/study_pace.c) $(LIBAPP_A),))
