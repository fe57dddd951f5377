# make install, its parts and its undoing. Each part is laid out in build/stage/ as it will lie, then tools/install.sh puts it there and
# writes the list of it that `make uninstall` goes by.
LIBDIR ?= $(PREFIX)/lib
DOCDIR := $(PREFIX)/share/doc/tensormass
SHARE := $(PREFIX)/share/tensormass
# A folder of this run's own, made when it is first asked for: two may install at once.
STAGE = $(eval STAGE := $(shell mkdir -p $(OUT)/stage && mktemp -d $(OUT)/stage/XXXXXX))$(STAGE)
# The solve library is part of it where CHOLMOD and Eigen are.
SOLVE ?= $(if $(and $(wildcard /usr/include/suitesparse/cholmod.h),$(wildcard /usr/include/eigen3/Eigen/Core)),1,0)
SOLVE_LIBRARIES := $(if $(filter 1,$(SOLVE)),$(LIBTMS_A) $(LIBTMS_SO))
# The scene library where libyaml is.
SCENE ?= $(if $(shell test -s /usr/include/yaml.h && echo there),1,0)
SCENE_LIBRARIES := $(if $(filter 1,$(SCENE)),$(LIBTMSCENE_A) $(LIBTMSCENE_SO))

# What links against a library that the loader does not look for by itself is told where it lies. $(call pc,NAMES)
RPATH := $(if $(filter /lib /lib/% /usr/lib /usr/lib/%,$(LIBDIR)),,-Wl,-rpath,$${libdir} )
pc = for n in $(1); do sed -e 's|@PREFIX@|$(PREFIX)|' -e 's|@LIBDIR@|$(LIBDIR)|' -e 's|@RPATH@|$(RPATH)|' -e 's|@VERSION@|$(VERSION)|' tools/$$n.pc.in \
	> $(STAGE)/$@$(LIBDIR)/pkgconfig/$$n.pc || exit 1; done
# For find_package(tensormass) of CMake: where the headers lie from the libraries, so that the prefix may be moved.
cmake = for n in tensormassConfig tensormassConfigVersion; do sed -e 's|@INCLUDE@|$(shell realpath -m --relative-to=$(LIBDIR) $(PREFIX)/include)|' -e 's|@VERSION@|$(VERSION)|' \
	-e 's|@SOVERSION@|$(SOVERSION)|' -e "s|@POINTER@|$$(echo __SIZEOF_POINTER__ | $(CC) -E -P -)|" tools/$$n.cmake.in > $(STAGE)/$@$(LIBDIR)/cmake/tensormass/$$n.cmake || exit 1; done
# $(call folders,NAMES): made anew in the part's stage.
folders = $(if $(filter-out /%,$(PREFIX) $(LIBDIR)),$(error PREFIX=$(PREFIX) LIBDIR=$(LIBDIR): give paths from / on))rm -rf $(STAGE)/$@ && mkdir -p $(foreach f,$(1),$(STAGE)/$@$(f))
# $(call pages,PAGES,OTHERS): each with the links that lead somewhere there: to one of PAGES, or of OTHERS in the same folder.
pages = for p in $(1); do awk -v have="$(notdir $(1)) LICENSE $(2)" -f tools/install_pages.awk $$p > $(STAGE)/$@$(DOCDIR)/$$(basename $$p) || exit 1; done
put = DESTDIR='$(DESTDIR)' PREFIX='$(PREFIX)' tools/install.sh put $@ $(STAGE)/$@

# Man pages and completion, where there is a Python to make them of the programs' help.
PYTHON3 := $(shell command -v /usr/bin/python3 || command -v python3)
REFERENCE_OF = $(notdir $(filter-out %-mpi,$(1)))
REFERENCE_PROGRAMS = $(call REFERENCE_OF,$(PROGRAMS) $(SESSION_PROGRAM) $(ORGAN_PROGRAM))
# $(call reference,PROGRAMS): into the part's stage.
reference = $(if $(PYTHON3),$(PYTHON3) tools/reference/make_reference.py $(OUT)/bin $(OUT)/reference $(VERSION) $(call REFERENCE_OF,$(1)) && \
	install -m 644 -Dt $(STAGE)/$@$(PREFIX)/share/man/man1 $(patsubst %,$(OUT)/reference/man1/%.1,$(call REFERENCE_OF,$(1))) && \
	install -m 644 -Dt $(STAGE)/$@$(PREFIX)/share/bash-completion/completions $(patsubst %,$(OUT)/reference/completions/%,$(call REFERENCE_OF,$(1))),true)

.PHONY: install install-lib install-controller install-programs uninstall
#: make install PREFIX= LIBDIR= DESTDIR=  all of it: the three parts below
install: install-lib install-controller install-programs

#: make install-lib          the libraries: headers, .so, .a, pkg-config, CMake, guide; the solve library where CHOLMOD and Eigen are, the scene library where libyaml is
install-lib: $(LIBTM_A) $(LIBTM_SO) $(LIBTMIO_A) $(LIBTMIO_SO) $(SOLVE_LIBRARIES) $(SCENE_LIBRARIES)
	@$(call folders,$(PREFIX)/include/tensormass $(LIBDIR)/pkgconfig $(LIBDIR)/cmake/tensormass $(DOCDIR)/examples)
	install -m 644 $(filter-out $(if $(SOLVE_LIBRARIES),,%_solve.h),$(wildcard libtensormass/include/*.h*)) libtensormass/io/include/* $(if $(SCENE_LIBRARIES),libtensormass/scene/include/*) $(STAGE)/$@$(PREFIX)/include
	install -m 644 libtensormass/include/tensormass/*.h $(STAGE)/$@$(PREFIX)/include/tensormass
	cp -P $(foreach l,$(filter %.a %.$(VERSION),$^),$(l) $(if $(filter %.a,$(l)),,$(patsubst %.$(VERSION),%.$(SOVERSION),$(l)) $(patsubst %.$(VERSION),%,$(l)))) $(STAGE)/$@$(LIBDIR)
	$(call pc,tensormass tensormass_io $(if $(SOLVE_LIBRARIES),tensormass_solve) $(if $(SCENE_LIBRARIES),tensormass_scene))
	$(call cmake)
	install -m 644 LICENSE $(STAGE)/$@$(DOCDIR)
	$(call pages,CHANGELOG.md $(addprefix docs/,library-guide.md scene-guide.md scene-reference.md meshes.md models.md contact.md physics.md),examples/block.c examples/engine.c examples/press.c)
	install -m 644 tests/install/block.c examples/engine/engine.c examples/scene/press.c $(STAGE)/$@$(DOCDIR)/examples
	@$(put)

#: make install-controller   haptic-rt, tm-device, their service, profiles and DBC, the LCM types and bindings, libhrt
install-controller: $(HRT_PROGRAMS) $(OUT)/lib/tensormass/lcm.so $(LIBHRT_A) $(LIBLCMTYPES_A) $(OUT)/python/tensormass_lcm/__init__.py
	@$(call folders,$(addprefix $(PREFIX)/,bin lib/tensormass lib/systemd/system include/tensormass_hrt/can include/tensormass_lcm/lcm_types) $(LIBDIR)/pkgconfig $(DOCDIR) \
		$(addprefix $(SHARE)/,systemd profiles can lcm_types python/tensormass_lcm))
	install -m 755 $(HRT_PROGRAMS) $(STAGE)/$@$(PREFIX)/bin
	install -m 755 $(OUT)/lib/tensormass/lcm.so $(STAGE)/$@$(PREFIX)/lib/tensormass
	sed -e 's|@PREFIX@|$(PREFIX)|' haptic_rt/systemd/haptic-rt@.service.in > $(STAGE)/$@$(PREFIX)/lib/systemd/system/haptic-rt@.service
	install -m 644 $(addprefix haptic_rt/systemd/,haptic-rt-0.conf processor.conf 80-can.network) $(STAGE)/$@$(SHARE)/systemd
	$(call reference,$(HRT_PROGRAMS))
	install -m 644 haptic_rt/device/profiles/* $(STAGE)/$@$(SHARE)/profiles
	install -m 644 haptic_rt/can/impulse_engine.dbc $(STAGE)/$@$(SHARE)/can
	install -m 644 lcm_types/*.lcm $(STAGE)/$@$(SHARE)/lcm_types
	install -m 644 $(OUT)/python/tensormass_lcm/*.py $(STAGE)/$@$(SHARE)/python/tensormass_lcm
	install -m 644 $(OUT)/gen/lcm_types/*.h $(STAGE)/$@$(PREFIX)/include/tensormass_lcm/lcm_types
	install -m 644 lcm_types/seal.h lcm_types/receiver.h lcm_types/event_log.h $(STAGE)/$@$(PREFIX)/include/tensormass_lcm
	install -m 644 $(LIBLCMTYPES_A) $(STAGE)/$@$(LIBDIR)/libtensormass_lcm.a
	install -m 644 haptic_rt/core/hrt.h haptic_rt/core/gate.h $(STAGE)/$@$(PREFIX)/include/tensormass_hrt
	install -m 644 haptic_rt/can/*.h $(STAGE)/$@$(PREFIX)/include/tensormass_hrt/can
	install -m 644 $(LIBHRT_A) $(STAGE)/$@$(LIBDIR)/libtensormass_hrt.a
	$(call pc,tensormass_hrt tensormass_lcm)
	install -m 644 LICENSE $(STAGE)/$@$(DOCDIR)
	$(call pages,CHANGELOG.md $(addprefix docs/,controller.md dedicated-machine.md can.md messages.md trust.md extrapolation.md firmware.md))
	@$(put)

#: make install-programs     simulation, viewer, tm-session and the rest, with scenes and meshes
install-programs: programs
	@$(call folders,$(addprefix $(PREFIX)/,bin lib/tensormass/session) $(DOCDIR)/images $(addprefix $(SHARE)/,apps/scenes apps/pages apps/studies/accuracy/reference meshes))
	install -m 755 $(filter-out $(HRT_PROGRAMS),$(PROGRAMS)) $(SESSION_PROGRAM) $(ORGAN_PROGRAM) $(STAGE)/$@$(PREFIX)/bin
	$(call reference,$(filter-out $(HRT_PROGRAMS),$(PROGRAMS)) $(SESSION_PROGRAM) $(ORGAN_PROGRAM))
	install -m 755 $(MODULES) $(STAGE)/$@$(PREFIX)/lib/tensormass
	install -m 755 $(SESSION_PARTS) $(STAGE)/$@$(PREFIX)/lib/tensormass/session
	cp -R apps/scenes/. $(STAGE)/$@$(SHARE)/apps/scenes
	install -m 644 apps/studies/accuracy/reference/reference.json $(STAGE)/$@$(SHARE)/apps/studies/accuracy/reference
	install -m 644 apps/studies/accuracy/scene_page.py $(STAGE)/$@$(SHARE)/apps/studies/accuracy
	install -m 644 apps/pages/page.py $(STAGE)/$@$(SHARE)/apps/pages
	install -m 644 $(wildcard meshes/*.msh meshes/*.csv meshes/README.md) $(STAGE)/$@$(SHARE)/meshes
	install -m 644 LICENSE $(STAGE)/$@$(DOCDIR)
	install -m 644 $(wildcard docs/images/*) $(STAGE)/$@$(DOCDIR)/images
	$(call pages,README.md CHANGELOG.md $(wildcard docs/*.md),$(patsubst docs/%,%,$(wildcard docs/images/*)))
	@$(put)

#: make uninstall PREFIX= DESTDIR=  what was installed there, and nothing else
uninstall:
	@DESTDIR='$(DESTDIR)' PREFIX='$(PREFIX)' tools/install.sh remove
