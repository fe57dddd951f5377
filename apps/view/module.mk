# tm-view, and the modules it opens when asked: osmesa.so draws (opengl.so where a window is open), lcm.so listens to the network.
VIEW_STUDIO_SRC := $(addprefix apps/view/,camera.c font.c layout.c overlay.c picture.c studio.c)
VIEW_FEED_SRC := $(addprefix apps/view/,feed.c inbox.c intake.c)
VIEW_SRC := $(VIEW_STUDIO_SRC) $(VIEW_FEED_SRC) $(addprefix apps/view/,inside.c main.c marks_find.c options.c output.c regions.c scene_marks.c still.c)
$(eval $(call program,tm-view,$(VIEW_SRC),$(SIM_LIBS),$$(call pkg_libs,libpng) -lyaml -lcjson))
VIEW_RENDER_SRC := $(addprefix apps/view/,camera.c fairing.c marks.c marks_find.c picture.c reference.c render.c render_light.c render_make.c shapes.c sides.c skin.c)
$(eval $(call module,osmesa,$(VIEW_RENDER_SRC) apps/view/context_osmesa.c,,$$(call pkg_libs,osmesa)))
$(eval $(call module,opengl,$(VIEW_RENDER_SRC) apps/view/context_window.c,,$$(call pkg_libs,sdl2 gl)))
$(OUT)/obj/apps/view/context_window.o: CFLAGS_EXTRA += $(call pkg_cflags,sdl2)
