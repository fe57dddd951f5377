# tm-accuracy measures, page.py draws.
ACCURACY_SRC := $(sort $(wildcard apps/studies/accuracy/*.c))
$(eval $(call program,tm-accuracy,$(ACCURACY_SRC),$(LIBREPLAY_A) $(LIBAPP_A) $(SIM_LIBS),-lyaml -lcjson))

#: make accuracy               what accuracy costs in time: build/accuracy/index.html (QUICK=1: the short form)
.PHONY: accuracy accuracy-run
accuracy:
	@tools/setup.sh build
	@$(MAKE) --no-print-directory venv
	@$(MAKE) --no-print-directory -j$$(nproc) programs
	@$(MAKE) --no-print-directory accuracy-run
accuracy-run:
	@mkdir -p $(OUT)/accuracy
	$(OUT)/bin/tm-accuracy $(if $(QUICK),--quick) --json $(OUT)/accuracy/figures.json
	TM_CC=$(CC) TM_FLAGS='$(OPT) -ffp-contract=off' $(VENV)/bin/python apps/studies/accuracy/page.py $(OUT)/accuracy/figures.json $(if $(wildcard $(OUT)/evaluate/rates.json),--rates $(OUT)/evaluate/rates.json) -o $(OUT)/accuracy
