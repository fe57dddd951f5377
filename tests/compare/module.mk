# The same press in other programs (docs/compared.md): MuJoCo and Newton of PyPI in an environment of their own, ours as the wheel has it. Nothing else waits for it.
COMPARE := $(OUT)/compare
.PHONY: compare compare-venv
# What pip cannot get is missing in the table; the rest is compared.
compare-venv:
	@mkdir -p $(COMPARE)
	@cmp -s tests/compare/requirements.txt $(COMPARE)/venv/.done || { /usr/bin/python3 -m venv $(COMPARE)/venv && \
		$(COMPARE)/venv/bin/pip install -q --disable-pip-version-check -r tests/compare/requirements.txt && cp tests/compare/requirements.txt $(COMPARE)/venv/.done; } || \
		echo "make compare: pip could not install all that tests/compare/requirements.txt names (the network, or the package index?); what is not there is left out" >&2
#: make compare                the same press in MuJoCo's flex and Newton (from PyPI), beside ours: error against time in build/compare/ (ARGS="--help")
compare: wheel compare-venv venv
	@rm -rf $(COMPARE)/python && $(VENV)/bin/python -m zipfile -e $(OUT)/wheel/*linux*_$$(uname -m).whl $(COMPARE)/python
	@$(VENV)/bin/python tests/compare/compare.py --out $(COMPARE) --ours $(abspath $(COMPARE))/python --peers $(abspath $(COMPARE))/venv/bin/python $(ARGS)
