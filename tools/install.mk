# make install, its parts and make uninstall. Each part is laid out in build/stage/ as it is installed; then tools/install.sh copies it and
# writes its list of files, which `make uninstall` uses.
LIBDIR ?= $(PREFIX)/lib
DOCDIR := $(PREFIX)/share/doc/tensormass
SHARE := $(PREFIX)/share/tensormass
# A folder of this run, made at the first use: two installations may run at once.
STAGE = $(eval STAGE := $(shell mkdir -p $(OUT)/stage && mktemp -d $(OUT)/stage/XXXXXX))$(STAGE)
# Includes the solve library if CHOLMOD and Eigen are present, and the scene library if libyaml is.
SOLVE ?= $(if $(and $(wildcard /usr/include/suitesparse/cholmod.h),$(wildcard /usr/include/eigen3/Eigen/Core)),1,0)
SCENE ?= $(if $(shell test -s /usr/include/yaml.h && echo there),1,0)
INSTALLED := tensormass tensormass_io $(if $(filter 1,$(SOLVE)),tensormass_solve) $(if $(filter 1,$(SCENE)),tensormass_scene)

# First and last line of a part; $(call to,FOLDER,FILES,MODE [644]): copies files into the part's stage.
begin = @$(if $(filter-out /%,$(PREFIX) $(LIBDIR)),$(error PREFIX=$(PREFIX) LIBDIR=$(LIBDIR): give paths from / on))rm -rf $(STAGE)/$@
put = @DESTDIR='$(DESTDIR)' PREFIX='$(PREFIX)' tools/install.sh put $@ $(STAGE)/$@
to = install -m $(or $(3),644) -Dt $(STAGE)/$@$(1) $(2)
# $(call filled,FOLDER,NAMES,SED...): tools/NAME.in with its @WORDS@ replaced.
filled = mkdir -p $(STAGE)/$@$(1); for n in $(2); do sed $(3) -e 's|@VERSION@|$(VERSION)|' tools/$$n.in > $(STAGE)/$@$(1)/$$n || exit 1; done
# $(call pc,NAMES): pkg-config files. They state the library's folder if the loader does not search it.
RPATH := $(if $(filter /lib /lib/% /usr/lib /usr/lib/%,$(LIBDIR)),,-Wl,-rpath,$${libdir} )
pc = $(call filled,$(LIBDIR)/pkgconfig,$(1:%=%.pc),-e 's|@PREFIX@|$(PREFIX)|' -e 's|@LIBDIR@|$(LIBDIR)|' -e 's|@RPATH@|$(RPATH)|')
# For find_package(tensormass) of CMake: path of the headers relative to the libraries, so that the prefix may be moved.
cmake = $(call filled,$(LIBDIR)/cmake/tensormass,tensormassConfig.cmake tensormassConfigVersion.cmake,-e 's|@INCLUDE@|$(shell realpath -m --relative-to=$(LIBDIR) $(PREFIX)/include)|' \
	-e 's|@SOVERSION@|$(SOVERSION)|' -e "s|@POINTER@|$$(echo __SIZEOF_POINTER__ | $(CC) -E -P -)|")
# $(call pages,PAGES,OTHERS): LICENSE and the pages, with those links that are valid there: to PAGES, or to OTHERS in the same folder.
pages = $(call to,$(DOCDIR),LICENSE); for p in $(1); do awk -v have="$(notdir $(1)) LICENSE $(2)" -f tools/install_pages.awk $$p > $(STAGE)/$@$(DOCDIR)/$$(basename $$p) || exit 1; done
# $(call reference,PROGRAMS): man pages and completion, if there is a Python to make them from the programs' help.
PYTHON3 := $(shell command -v /usr/bin/python3 || command -v python3)
REFERENCE_OF = $(notdir $(filter-out %-mpi,$(1)))
reference = $(if $(PYTHON3),$(PYTHON3) tools/reference/make_reference.py $(OUT)/bin $(OUT)/reference $(VERSION) $(call REFERENCE_OF,$(1)) && \
	$(call to,$(PREFIX)/share/man/man1,$(patsubst %,$(OUT)/reference/man1/%.1,$(call REFERENCE_OF,$(1)))) && \
	$(call to,$(PREFIX)/share/bash-completion/completions,$(patsubst %,$(OUT)/reference/completions/%,$(call REFERENCE_OF,$(1)))),true)

#: make install PREFIX= LIBDIR= DESTDIR=  all of it: the three parts below
install: install-lib install-controller install-programs

#: make install-lib          the libraries: headers, .so, .a, pkg-config, CMake, guide; the solve library where CHOLMOD and Eigen are, the scene library where libyaml is
install-lib: $(call lib,$(INSTALLED)) $(INSTALLED:%=$(OUT)/lib/lib%.so.$(VERSION))
	$(begin)
	$(call to,$(PREFIX)/include,$(wildcard $(foreach l,$(INSTALLED),libtensormass/include/$(l).h* libtensormass/*/include/$(l).h*)))
	$(call to,$(PREFIX)/include/tensormass,libtensormass/include/tensormass/*.h)
	mkdir -p $(STAGE)/$@$(LIBDIR) && cp -P $^ $(foreach s,$(VERSION) $(SOVERSION),$(patsubst %.$(VERSION),%$(if $(filter $(SOVERSION),$(s)),.$(s)),$(filter %.$(VERSION),$^))) $(STAGE)/$@$(LIBDIR)
	$(call pc,$(INSTALLED))
	$(call cmake)
	$(call pages,CHANGELOG.md $(addprefix docs/,library-guide.md library-api.md library-models.md scene-guide.md scene-reference.md bodies.md bodies-results.md meshes.md meshes-from-images.md mesh-formats.md mesh-generation.md models.md models-theory.md hybrid.md precomputing.md contact.md contact-solve.md physics.md \
		strain-smoothing.md corotation.md corotation-smoothing.md corotation-single.md nonlinear-laws.md nonlinear-steps.md nonlinear-effects.md viscosity.md time-stepping.md equilibrium.md energy.md grasping.md passivity.md friction.md cutting.md patches.md compliance.md),examples/block.c examples/engine.c examples/press.c)
	$(call to,$(DOCDIR)/examples,tests/install/block.c examples/engine/engine.c examples/scene/press.c)
	$(put)

#: make install-controller   haptic-rt, tm-device, their service, profiles and DBC, the LCM types and bindings, libhrt
HRT_PROGRAMS := $(OUT)/bin/haptic-rt $(OUT)/bin/tm-device
install-controller: $(HRT_PROGRAMS) $(OUT)/lib/tensormass/lcm.so $(call lib,hrt lcm_types) $(OUT)/python/tensormass_lcm/__init__.py
	$(begin)
	$(call to,$(PREFIX)/bin,$(HRT_PROGRAMS),755)
	$(call to,$(PREFIX)/lib/tensormass,$(OUT)/lib/tensormass/lcm.so,755)
	$(call to,$(SHARE)/systemd,$(addprefix haptic_rt/systemd/,haptic-rt-0.conf processor.conf 80-can.network))
	mkdir -p $(STAGE)/$@$(PREFIX)/lib/systemd/system && sed -e 's|@PREFIX@|$(PREFIX)|' haptic_rt/systemd/haptic-rt@.service.in > $(STAGE)/$@$(PREFIX)/lib/systemd/system/haptic-rt@.service
	$(call reference,$(HRT_PROGRAMS))
	$(call to,$(SHARE)/profiles,haptic_rt/device/profiles/*)
	$(call to,$(SHARE)/can,haptic_rt/can/impulse_engine.dbc)
	$(call to,$(SHARE)/lcm_types,lcm_types/*.lcm)
	$(call to,$(SHARE)/python/tensormass_lcm,$(OUT)/python/tensormass_lcm/*.py)
	$(call to,$(PREFIX)/include/tensormass_lcm/lcm_types,$(OUT)/gen/lcm_types/*.h)
	$(call to,$(PREFIX)/include/tensormass_lcm,$(addprefix lcm_types/,auth.h receiver.h event_log.h))
	$(call to,$(PREFIX)/include/tensormass_hrt,haptic_rt/core/hrt.h haptic_rt/core/gate.h)
	$(call to,$(PREFIX)/include/tensormass_hrt/can,haptic_rt/can/*.h)
	$(call pc,tensormass_hrt tensormass_lcm)
	install -m 644 $(call lib,hrt) $(STAGE)/$@$(LIBDIR)/libtensormass_hrt.a
	install -m 644 $(call lib,lcm_types) $(STAGE)/$@$(LIBDIR)/libtensormass_lcm.a
	$(call pages,CHANGELOG.md $(addprefix docs/,controller.md controller-loop.md passivity-control.md extrapolators.md dedicated-machine.md can.md devices.md messages.md trust.md extrapolation.md firmware.md))
	$(put)

#: make install-programs     simulation, viewer, tm-session and the rest, with scenes and meshes
PYTHON_PROGRAMS := $(filter $(OUT)/bin/%,$(SCRIPTS))
OTHER_PROGRAMS := $(filter-out $(HRT_PROGRAMS),$(PROGRAMS)) $(PYTHON_PROGRAMS)
install-programs: programs
	$(begin)
	$(call to,$(PREFIX)/bin,$(OTHER_PROGRAMS),755)
	$(call reference,$(OTHER_PROGRAMS))
	$(call to,$(PREFIX)/lib/tensormass,$(MODULES),755)
	$(foreach d,session fit organ,$(call to,$(PREFIX)/lib/tensormass/$(d),$(filter $(OUT)/lib/tensormass/$(d)/%,$(SCRIPTS)),755) && )true
	mkdir -p $(STAGE)/$@$(SHARE)/apps && cp -R apps/scenes $(STAGE)/$@$(SHARE)/apps
	$(call to,$(SHARE)/apps/studies/accuracy/reference,apps/studies/accuracy/reference/reference.json apps/studies/accuracy/reference/laws.json)
	$(call to,$(SHARE)/apps/studies/accuracy,apps/studies/accuracy/scene_page.py)
	$(call to,$(SHARE)/apps/pages,apps/pages/page.py)
	$(call to,$(SHARE)/meshes,$(wildcard meshes/*.msh meshes/*.csv meshes/README.md))
	$(call to,$(DOCDIR)/images,docs/images/*)
	$(call pages,README.md CHANGELOG.md $(wildcard docs/*.md),$(patsubst docs/%,%,$(wildcard docs/images/*)))
	$(put)

#: make uninstall PREFIX= DESTDIR=  what was installed there, and nothing else
uninstall:
	@DESTDIR='$(DESTDIR)' PREFIX='$(PREFIX)' tools/install.sh remove
