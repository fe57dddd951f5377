# The precomputed and the hybrid model.
$(call objects,tests/solve/test_static.c): INCLUDES += -I/usr/include/suitesparse
$(foreach t,$(sort $(wildcard tests/solve/test_*.c)),$(eval $(call test,$(t),$(LIBTMS_A) $(LIBTM_A),$(TMS_LIBS))))

# What they cost. Not a test: nothing is asserted.
BENCH_MODELS := $(OUT)/tests/solve/bench_models
$(BENCH_MODELS): $(call objects,tests/solve/bench_models.c) $(LIBAPP_A) $(LIBTMS_A) $(LIBTM_A)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -rdynamic -o $@ $(call objects,tests/solve/bench_models.c) -Wl,--start-group $(LIBAPP_A) $(LIBTMS_A) $(LIBTM_A) -Wl,--end-group $(TMS_LIBS) -lcmocka -lcjson -ldl -lm -lpthread
#: make bench-models           cost of precomputing against mesh size, and of one update on line: build/bench/models.json (QUICK=1: the small organ)
.PHONY: bench-models
bench-models: $(BENCH_MODELS)
	@mkdir -p $(OUT)/bench
	TM_COMMIT=$$(git rev-parse --short HEAD 2>/dev/null) TM_FLAGS='$(OPT) -ffp-contract=off' $(BENCH_MODELS) $(OUT)/bench/models.json $(if $(QUICK),--quick)
