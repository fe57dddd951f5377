# tm-evaluate measures, page.py draws.
EVALUATE_SRC := $(sort $(wildcard apps/evaluate/*.c))
$(eval $(call program,tm-evaluate,$(EVALUATE_SRC),$(SIM_LIBS) $(LIBLCMTYPES_A),-llcm -lyaml -lcjson))
$(call objects,$(EVALUATE_SRC)): $(LCM_GEN)
