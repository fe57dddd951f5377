# The MuJoCo plugin (docs/mujoco.md), built with the headers and the library of MuJoCo's PyPI package. Nothing else depends on it.
MUJOCO := $(OUT)/mujoco
MUJOCO_PACKAGE = $(firstword $(wildcard $(MUJOCO)/venv/lib/python3*/site-packages/mujoco))
$(MUJOCO)/venv/.done: plugins/mujoco/requirements.txt
$(OUT)/obj/plugins/mujoco/tissue.o: BASE_CFLAGS += -isystem $(MUJOCO_PACKAGE)/include
$(OUT)/obj/plugins/mujoco/tissue.o: $(MUJOCO)/venv/.done
# Scenes and solvers are in the same folder and found from there.
$(MUJOCO)/lib%.so.$(SOVERSION): $(OUT)/python-lib/lib%.so.$(SOVERSION)
	$(call step,COPY)
	$(Q)cp $< $@
$(MUJOCO)/libtensormass_mujoco.so: $(OUT)/obj/plugins/mujoco/tissue.o $(patsubst %,$(MUJOCO)/lib%.so.$(SOVERSION),tensormass_scene tensormass tensormass_io tensormass_solve)
	$(call step,LINK)
	$(Q)$(CC) $(SAN) -shared -o $@ $(wordlist 1,3,$^) $(wildcard $(MUJOCO_PACKAGE)/libmujoco.so.*) -Wl,--disable-new-dtags -Wl,-rpath,'$$ORIGIN' -Wl,-rpath,$(abspath $(MUJOCO_PACKAGE)) -lm
#: make mujoco                 the MuJoCo plugin, against MuJoCo's PyPI package: build/mujoco/libtensormass_mujoco.so
mujoco: $(MUJOCO)/venv/.done
	@$(MAKE) --no-print-directory $(MUJOCO)/libtensormass_mujoco.so
