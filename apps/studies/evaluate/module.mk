# tm-evaluate measures, page.py draws.
EVALUATE_SRC := $(sort $(wildcard apps/studies/evaluate/*.c))
$(eval $(call program,tm-evaluate,$(EVALUATE_SRC),$(LIBREPLAY_A) $(LIBAPP_A) $(SIM_LIBS),-lyaml -lcjson))

#: make evaluate               extrapolation errors: build/evaluate/index.html (QUICK=1: the short form)
.PHONY: evaluate evaluate-run
evaluate:
	@tools/setup.sh build
	@$(MAKE) --no-print-directory venv
	@$(MAKE) --no-print-directory -j$$(nproc) programs
	@$(MAKE) --no-print-directory evaluate-run
# Of tm-stability, shown here too.
TORTURE := spike-1mm spike-10mm spike-50mm spike-100mm tears-away each-its-own lump-20 replays doubled reordered loss-10 delay-50 two-sims
evaluate-run:
	@mkdir -p $(OUT)/evaluate
	$(OUT)/bin/tm-evaluate --study $(if $(QUICK),--quick) $(EVALUATE_ARGS) --json $(OUT)/evaluate/figures.json
	$(OUT)/bin/tm-stability $(if $(QUICK),--quick) $(TORTURE:%=--case %) --quiet --json $(OUT)/evaluate/torture.json || [ $$? -eq 1 ]
	TM_CC=$(CC) TM_FLAGS='$(OPT) -ffp-contract=off' $(VENV)/bin/python apps/studies/evaluate/page.py $(OUT)/evaluate/figures.json -o $(OUT)/evaluate --torture $(OUT)/evaluate/torture.json
