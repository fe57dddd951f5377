#: make demo                   the ring in real time and in lockstep: pictures, film, force plot, figures in build/demo
#: make spy                    lcm-spy on the session that runs
DEMO_SCENE ?= apps/scenes/liver-cut.yaml
DEMO_CAMERA ?= --azimuth -72 --elevation 32 --zoom 1.15
DEMO_ARGS ?=
.PHONY: demo spy
demo:
	@tools/setup.sh build demo
	@+$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$$(nproc)) all venv
	@$(VENV)/bin/python apps/demo/demo.py --build $(OUT) --scene $(DEMO_SCENE) --camera='$(DEMO_CAMERA)' $(DEMO_ARGS)

# lcm-spy in the network of the session that runs (make demo, make play).
spy:
	@OUT=$(OUT) apps/demo/spy.sh
