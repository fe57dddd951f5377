# The MuJoCo plugin (docs/mujoco.md), against the headers and the library that MuJoCo's PyPI package brings. Nothing else waits for it.
MUJOCO := $(OUT)/mujoco
MUJOCO_PACKAGE = $(firstword $(wildcard $(MUJOCO)/venv/lib/python3*/site-packages/mujoco))
$(MUJOCO)/venv/.done: plugins/mujoco/requirements.txt
$(OUT)/obj/plugins/mujoco/tissue.o: BASE_CFLAGS += -isystem $(MUJOCO_PACKAGE)/include
$(OUT)/obj/plugins/mujoco/tissue.o: $(MUJOCO)/venv/.done
# Scenes and solvers lie beside it, and are found from there.
$(MUJOCO)/lib%.so.$(SOVERSION): $(OUT)/python-lib/lib%.so.$(SOVERSION)
	$(call step,COPY)
	$(Q)cp $< $@
$(MUJOCO)/libtensormass_mujoco.so: $(OUT)/obj/plugins/mujoco/tissue.o $(patsubst %,$(MUJOCO)/lib%.so.$(SOVERSION),tensormass_scene tensormass tensormass_io tensormass_solve)
	$(call step,LINK)
	$(Q)$(CC) $(SAN) -shared -o $@ $(wordlist 1,3,$^) $(wildcard $(MUJOCO_PACKAGE)/libmujoco.so.*) -Wl,--disable-new-dtags -Wl,-rpath,'$$ORIGIN' -Wl,-rpath,$(abspath $(MUJOCO_PACKAGE)) -lm
#: make mujoco                 the MuJoCo plugin, against MuJoCo's PyPI package: build/mujoco/libtensormass_mujoco.so
mujoco: $(MUJOCO)/venv/.done
	@$(MAKE) --no-print-directory $(MUJOCO)/libtensormass_mujoco.so
