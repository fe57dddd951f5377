# The suite in the builds of clang's sanitizers. make check runs a short form of it (test_sanitize.py).
SANITIZERS ?= asan tsan
#: make sanitize               the suite under ASan+UBSan and under TSan: build/sanitize.json, reports in build/{asan,tsan}/reports/
.PHONY: sanitize
sanitize:
	@tools/setup.sh build demo check
	@$(MAKE) --no-print-directory venv
	@for s in $(SANITIZERS); do $(MAKE) --no-print-directory config=$$s -j$$(nproc) tests || exit; done
	$(VENV)/bin/python tests/sanitize/run.py --build $(BUILD) $(foreach a,$(PYTEST_ARGS),--pytest=$(a)) $(SANITIZERS)
# Compiler and flags of a build, for tests that compile a file of their own.
.PHONY: print-flags
print-flags:
	@echo $(CC) $(OPT)
