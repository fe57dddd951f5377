# libtensormass_scene.so and .a: scenes read, checked, built and stepped. Besides its own it holds the devices, joints to tips, scripted hands and output files.
TMSCENE_SRC := $(sort $(wildcard libtensormass/scene/*.c))
TMSCENE_OBJ := $(call objects,$(TMSCENE_SRC) $(sort $(wildcard haptic_rt/motion/*.c)) haptic_rt/core/kinematics.c libtensormass/platform/output.c)
LIBTMSCENE_A := $(OUT)/lib/libtensormass_scene.a
LIBTMSCENE_SO := $(OUT)/lib/libtensormass_scene.so.$(VERSION)
LIBRARIES += $(LIBTMSCENE_A) $(LIBTMSCENE_SO)
$(call objects,libtensormass/scene/module_open.c): BASE_CFLAGS += -DTM_SOVERSION='"$(SOVERSION)"'
$(LIBTMSCENE_A): $(TMSCENE_OBJ)
	$(archive)
$(LIBTMSCENE_SO): $(TMSCENE_OBJ) $(LIBTM_SO) $(LIBTMIO_SO)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -shared -Wl,-soname,libtensormass_scene.so.$(SOVERSION) -Wl,-Bsymbolic $(if $(SAN),,-Wl,--no-undefined) $(ORIGIN) -o $@ $(TMSCENE_OBJ) -L$(OUT)/lib -ltensormass_io -ltensormass -lyaml -ldl -lm
	$(Q)ln -sf $(@F) $(@D)/libtensormass_scene.so.$(SOVERSION) && ln -sf libtensormass_scene.so.$(SOVERSION) $(@D)/libtensormass_scene.so
# What a program around scenes links (apps/common/program_host.h); -lyaml beside.
SCENE_LIBS = $(LIBAPP_OWN_A) $(LIBTMSCENE_A) $(LIBPLATFORM_A) $(LIBTMIO_A) $(LIBTM_A)
