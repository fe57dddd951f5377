# make demo, make spy.
DEMO_SCENE ?= apps/scenes/liver-press.yaml
DEMO_ARGS ?=
.PHONY: demo spy
demo:
	@tools/setup.sh build demo
	@+$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$$(nproc)) all venv
	@$(VENV)/bin/python apps/demo/demo.py --build $(OUT) --scene $(DEMO_SCENE) $(DEMO_ARGS)

# lcm-spy in the network of the session that runs (make demo, make play).
spy:
	@OUT=$(OUT) apps/demo/spy.sh
