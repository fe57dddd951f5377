# tm-view, and the modules it opens when asked: osmesa.so draws, viewfeed.so listens to LCM and reads its logs.
VIEW_STUDIO_SRC := $(addprefix apps/view/,camera.c font.c layout.c overlay.c picture.c studio.c)
VIEW_SRC := $(VIEW_STUDIO_SRC) $(addprefix apps/view/,main.c options.c output.c scene_marks.c still.c)
$(eval $(call program,tm-view,$(VIEW_SRC),$(SIM_LIBS),$$(call pkg_libs,libpng) -lyaml -lcjson))
$(eval $(call module,osmesa,$(addprefix apps/view/,camera.c marks.c picture.c render.c shapes.c skin.c),,$$(call pkg_libs,osmesa)))
$(eval $(call module,viewfeed,$(addprefix apps/view/,feed.c intake.c picture.c) apps/common/wire.c,$(LIBLCMTYPES_A),$$(call pkg_libs,lcm)))
$(call objects,$(addprefix apps/view/,feed.c intake.c)): | $(LIBLCMTYPES_A)
