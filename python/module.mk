# The Python package (docs/python.md). Nothing else waits for it: `make wheel` and its tests alone build what is here.
# libtensormass_controller.so: the controller's core, its functions to be seen. libtensormass_scene.so: scenes, of what tm-sim is made of.
PYTHON_LIB := $(OUT)/python-lib
PYTHON_LIBRARIES := $(PYTHON_LIB)/libtensormass.so.$(SOVERSION) $(PYTHON_LIB)/libtensormass_solve.so.$(SOVERSION) \
	$(PYTHON_LIB)/libtensormass_controller.so $(PYTHON_LIB)/libtensormass_scene.so
PYTHON_CORE_SRC := $(filter haptic_rt/core/%,$(HRT_CORE_SRC))
PYTHON_CORE_OBJ := $(patsubst %.c,$(OUT)/obj/python/%.o,$(PYTHON_CORE_SRC))
PYTHON_SCENE_SRC := python/native/scene.c python/native/said.c
$(PYTHON_LIB)/%.so.$(SOVERSION): $(OUT)/lib/%.so.$(VERSION)
	@mkdir -p $(@D)
	cp $< $@
$(OUT)/obj/python/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(BASE_CFLAGS) -fvisibility=default $(INCLUDES) -c $< -o $@
$(PYTHON_LIB)/libtensormass_controller.so: $(PYTHON_CORE_OBJ)
	@mkdir -p $(@D)
	$(CC) $(SAN) -shared -Wl,-soname,$(@F) -o $@ $^ -lm
$(call objects,$(PYTHON_SCENE_SRC)): CFLAGS_EXTRA += -DTM_SOVERSION='"$(SOVERSION)"'
# Ours first: said.c stands in for two objects of libapp.a.
$(PYTHON_LIB)/libtensormass_scene.so: $(call objects,$(PYTHON_SCENE_SRC)) $(filter-out $(LIBTM_A),$(SIM_LIBS)) $(LIBTM_SO)
	@mkdir -p $(@D)
	$(CC) $(SAN) -shared -Wl,-soname,$(@F) -Wl,-Bsymbolic $(if $(SAN),,-Wl,--no-undefined) -o $@ $(filter %.o,$^) \
		-Wl,--start-group $(filter %.a,$^) -Wl,--end-group -L$(OUT)/lib -ltensormass -lyaml -lcjson -ldl -lm -lpthread
.PHONY: python-libraries
python-libraries: $(PYTHON_LIBRARIES)
