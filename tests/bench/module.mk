# What a force pass, a step and a removed tetrahedron cost, beside this machine's memory bandwidth in the same run.
BENCH := $(OUT)/tests/bench/bench
$(BENCH): $(call objects,$(sort $(wildcard tests/bench/*.c))) $(LIBAPP_A) $(LIBTMS_A) $(LIBTM_A)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -rdynamic -o $@ $(call objects,$(sort $(wildcard tests/bench/*.c))) -Wl,--start-group $(LIBAPP_A) $(LIBTMS_A) $(LIBTM_A) -Wl,--end-group $(TMS_LIBS) -lcjson -ldl -lm
tests: $(BENCH)
# The naive loop once more, with what the best form uses.
ifeq ($(shell $(CC) -dumpmachine | cut -d- -f1),x86_64)
$(OUT)/obj/tests/bench/naive_wide.o: BASE_CFLAGS += -mavx2 -mfma -ffp-contract=fast
endif

#: make bench                  cost per edge, step and removed tetrahedron: build/bench/bench.json (QUICK=1: the short form; BASELINE=old.json: what has become slower, exit 1)
.PHONY: bench bench-run
bench:
	@tools/setup.sh build
	@$(MAKE) --no-print-directory $(BENCH) bench-run
bench-run:
	@mkdir -p $(OUT)/bench
	TM_COMMIT=$$(git rev-parse --short HEAD 2>/dev/null) TM_FLAGS='$(OPT) -ffp-contract=off' $(BENCH) $(if $(QUICK),--quick) --json $(OUT)/bench/bench.json
	$(if $(BASELINE),$(VENV)/bin/python tests/bench/compare.py $(BASELINE) $(OUT)/bench/bench.json)
