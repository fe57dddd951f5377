# tm-stability runs the hard cases, page.py draws their verdicts.
STABILITY_SRC := $(sort $(wildcard apps/studies/stability/*.c))
$(eval $(call program,tm-stability,$(STABILITY_SRC),$(LIBAPP_A) $(LIBTM_A) $(LIBHRT_DEVICE_A) $(LIBHRT_IO_A) $(LIBHRT_A),-lcjson))

#: make stability              every hard case and its verdict: build/stability/index.html (QUICK=1: the short form)
.PHONY: stability stability-run
stability:
	@tools/setup.sh build
	@$(MAKE) --no-print-directory venv
	@$(MAKE) --no-print-directory -j$$(nproc) programs
	@$(MAKE) --no-print-directory stability-run
stability-run:
	@mkdir -p $(OUT)/stability
	$(OUT)/bin/tm-stability $(if $(QUICK),--quick) --json $(OUT)/stability/verdicts.json; code=$$?; \
	TM_CC=$(CC) TM_FLAGS='$(OPT) -ffp-contract=off' $(VENV)/bin/python apps/studies/stability/page.py $(OUT)/stability/verdicts.json -o $(OUT)/stability --fuzz $(BUILD)/fuzz/fuzz.json --sanitize $(BUILD)/sanitize.json && exit $$code
