# The MuJoCo plugin (docs/mujoco.md), against the headers and the library that MuJoCo's PyPI package brings. Nothing else waits for it: `make mujoco` alone builds it.
MUJOCO_VENV := $(OUT)/mujoco/venv
MUJOCO = $(firstword $(wildcard $(MUJOCO_VENV)/lib/python3*/site-packages/mujoco))
MUJOCO_PLUGIN := $(OUT)/mujoco/libtensormass_mujoco.so
$(MUJOCO_VENV)/.done: plugins/mujoco/requirements.txt
	@mkdir -p $(@D)
	@/usr/bin/python3 -m venv $(@D)
	@$(@D)/bin/pip install -q --disable-pip-version-check -r $< || { echo "make mujoco: pip could not install what $< names; check the network or the package index" >&2; exit 2; }
	@touch $@
$(OUT)/obj/plugins/mujoco/tissue.o: plugins/mujoco/tissue.c Makefile $(MUJOCO_VENV)/.done
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(BASE_CFLAGS) $(INCLUDES) -isystem $(MUJOCO)/include -c $< -o $@
# Scenes and solvers lie beside it, and are found from there.
MUJOCO_LIBRARIES := $(patsubst $(PYTHON_LIB)/%,$(OUT)/mujoco/%,$(filter-out %_controller.so,$(PYTHON_LIBRARIES)))
$(MUJOCO_LIBRARIES): $(OUT)/mujoco/%: $(PYTHON_LIB)/%
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)cp $< $@
$(MUJOCO_PLUGIN): $(OUT)/obj/plugins/mujoco/tissue.o $(MUJOCO_LIBRARIES)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -shared -o $@ $< $(filter %/libtensormass_scene.so.$(SOVERSION),$^) $(filter %/libtensormass.so.$(SOVERSION),$^) $(wildcard $(MUJOCO)/libmujoco.so.*) \
		-Wl,--disable-new-dtags -Wl,-rpath,'$$ORIGIN' -Wl,-rpath,$(abspath $(MUJOCO)) -lm
.PHONY: mujoco
#: make mujoco                 the MuJoCo plugin, against MuJoCo's PyPI package: build/mujoco/libtensormass_mujoco.so
mujoco: $(MUJOCO_VENV)/.done
	@$(MAKE) --no-print-directory $(MUJOCO_PLUGIN)
