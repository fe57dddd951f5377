# libtensormass_scene.a: scenes read, checked, built and stepped.
TMSCENE_SRC := $(sort $(wildcard libtensormass/scene/*.c))
LIBTMSCENE_A := $(OUT)/lib/libtensormass_scene.a
LIBRARIES += $(LIBTMSCENE_A)
$(LIBTMSCENE_A): $(call objects,$(TMSCENE_SRC))
	$(archive)
# What programs that run a scene link; -lyaml beside.
SCENE_LIBS = $(LIBTMSCENE_A) $(LIBHRT_MOTION_A) $(LIBPLATFORM_A) $(LIBTMIO_A) $(LIBTM_A)
