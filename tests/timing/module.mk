# What Linux does to the loop: its lateness beside cyclictest's, its allocations and system calls.
COUNT_MALLOC := $(OUT)/tests/timing/count_malloc.so
$(COUNT_MALLOC): tests/timing/count_malloc.c
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) -shared -fPIC -O1 -Wall -o $@ $< -ldl
tests: $(COUNT_MALLOC)

#: make bench-timing           lateness of haptic-rt beside cyclictest, idle and busy: build/bench/timing.json (part of make bench; QUICK=1: the short form)
.PHONY: bench-timing
bench: bench-timing
bench-timing:
	@tools/setup.sh build check
	@$(MAKE) --no-print-directory programs venv
	@mkdir -p $(OUT)/bench
	$(VENV)/bin/python tests/timing/timing.py $(if $(QUICK),--quick) --bin $(OUT)/bin --json $(OUT)/bench/timing.json
