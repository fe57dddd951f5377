# tm-play and its window; make play.
PLAY_SRC := $(addprefix apps/play/,main.c controls.c) $(addprefix apps/view/,camera.c dress.c feed.c font.c inbox.c inside.c intake.c layout.c marks_find.c output.c overlay.c picture.c regions.c scene_marks.c still.c studio.c)
$(eval $(call program,tm-play,$(PLAY_SRC),$(SCENE_LIBS) $(LIBHRT_IO_A) $(LIBHRT_A) $(LIBLCMTYPES_A),$$(call pkg_libs,libpng) -lyaml -lcjson))
$(eval $(call module,window,apps/play/window.c,,$$(call pkg_libs,sdl2)))
$(OUT)/obj/apps/play/window.o: CFLAGS_EXTRA += $(call pkg_cflags,sdl2)
PLAY_SCENE ?= $(DEMO_SCENE)
PLAY_ARGS ?=
PLAY_WINDOW ?=
#: make play                   a window: mouse and keys move the instruments (PLAY_ARGS='--record session.lcm')
.PHONY: play
play:
	@[ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] || { echo "play: no display (neither DISPLAY nor WAYLAND_DISPLAY is set); run it on a desktop or over ssh -X, or use make demo, which needs none" >&2; exit 2; }
	@tools/setup.sh build demo
	@+$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$$(nproc)) all venv
	@$(VENV)/bin/python apps/play/play.py --build $(OUT) --scene $(PLAY_SCENE) $(PLAY_ARGS) -- $(DEMO_CAMERA) $(PLAY_WINDOW)
