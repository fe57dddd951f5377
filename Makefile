# tensormass. `make demo` and `make check` do everything and install what is missing; `make help` lists the other targets.
# config=release|debug|asan|tsan|fuzz|clang selects the build: release in build/, the others in build/<config>/. V=1 shows command lines.

, := ,
config ?= release
BUILD ?= build
OUT := $(BUILD)$(if $(filter-out release,$(config)),/$(config))
VENV ?= $(BUILD)/venv
PREFIX ?= /usr/local
DESTDIR ?=
VERSION := 0.2.0
# Changes when the C interface breaks: until 1.0 the second number, then the first (CONTRIBUTING.md).
SOVERSION := $(if $(filter 0.%,$(VERSION)),$(basename $(VERSION)),$(firstword $(subst ., ,$(VERSION))))

.DEFAULT_GOAL := all
.DELETE_ON_ERROR:
.SECONDARY:
SHELL := /bin/bash

CC_release := gcc
CC_debug := gcc
CC_asan := clang
CC_tsan := clang
CC_fuzz := clang
CC_clang := clang
CC_coverage := clang
CC := $(CC_$(config))
CXX := $(if $(filter gcc,$(CC)),g++,clang++)
$(if $(CC),,$(error config=$(config): no such build; use release, debug, asan, tsan, fuzz, coverage or clang))

OPT_release := -O3 -g -DNDEBUG
OPT_clang := -O3 -g -DNDEBUG
OPT_debug := -O0 -g
OPT_asan := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=undefined
OPT_tsan := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=thread
OPT_fuzz := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined
# Counts how often each region of the code runs (tests/sanitize/choose.py); the tests' own sources are not counted.
OPT_coverage := -O1 -fprofile-instr-generate
OPT := $(OPT_$(config))
# With a sanitizer the C++ library is linked from the start: the sanitizer must know its functions before a module with C++ is loaded. LLVM's linker, if it is
# there, takes a third of the time for the hundred programs, each with the sanitizer's library.
SAN := $(filter -fsanitize% -fprofile%,$(OPT)) $(if $(and $(filter asan tsan,$(config)),$(filter /%,$(shell $(CC) -print-prog-name=ld.lld))),-fuse-ld=lld) $(if $(filter -fsanitize%,$(OPT)),-Wl$(,)--push-state$(,)--no-as-needed -lstdc++ -Wl$(,)--pop-state)

# -ffp-contract=off: the plain form's bits must not depend on compiler or processor.
WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wconversion -Wno-sign-conversion $(if $(filter gcc,$(CC)),-Wno-format-truncation)
BASE_CFLAGS := -std=c11 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC -MMD -MP $(WARN)
# Two of the C++ checks require a runtime library that C programs do not link.
BASE_CXXFLAGS := -std=c++17 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC $(if $(findstring undefined,$(OPT)),-fno-sanitize=function$(,)vptr) -MMD -MP -Wall -Wextra
INCLUDES := -I. -Ilibtensormass/include -Ilibtensormass/io/include -Ilibtensormass/scene/include -Ilibtensormass/src -Ihaptic_rt/core -Ilibtensormass -Ilibtensormass/platform -Ihaptic_rt -Iapps -Iapps/common -Ilcm_types -I$(OUT)/gen

# Libraries find our other libraries in their own folder; packages for a system folder set ORIGIN= .
ORIGIN ?= -Wl,-rpath,'$$ORIGIN'

# Results of pkg-config, requested only when a recipe needs them (the same make may install the packages).
pkg_cflags = $(shell pkg-config --cflags $(1))
pkg_libs = $(shell pkg-config --libs $(1))

# First line of a recipe: makes the folder and prints one word and the file; V=1 shows the command lines instead.
Q := $(if $(V),,@)
step = @mkdir -p $(@D)$(if $(V),,; printf '  %-5s %s\n' '$(1)' '$(patsubst $(BUILD)/%,%,$@)')
files = $(sort $(wildcard $(1)))
# $(call objects,SOURCES), $(call lib,NAMES): object files of the sources; archives of our libraries with these names.
objects = $(patsubst %,$(OUT)/obj/%.o,$(basename $(1)))
lib = $(patsubst %,$(OUT)/lib/lib%.a,$(1))
# Our libraries that are linked together, by name.
APP_LIBS := app platform tensormass_io
SCENE_LIBS := app tensormass_scene platform tensormass_io tensormass
DEVICE_LIBS := hrt_device hrt_motion hrt_io hrt
SIM_LIBS := sim $(SCENE_LIBS) $(DEVICE_LIBS) lcm_types

# Each of these is one line of a module.mk. Libraries are named and resolved later, so that the lines may have any order.
# $(call library,NAME,SOURCES): build/lib/libNAME.a.
library = $(eval $(call library_rule,$(1),$(2)))
define library_rule
LIBRARIES += $(call lib,$(1))
$(call lib,$(1)): $(call objects,$(2))
	$$(call step,AR)
	$$(Q)rm -f $$@ && ar rcs $$@ $$^
endef
# $(call shared,NAME,SOURCES,OUR SHARED LIBRARIES,FLAGS): the same, and libNAME.so.
shared = $(eval $(call library_rule,$(1),$(2)))$(eval $(call shared_rule,$(1),$(2),$(3),$(4)))
define shared_rule
LIBRARIES += $(OUT)/lib/lib$(1).so.$(VERSION)
$(OUT)/lib/lib$(1).so.$(VERSION): $(call objects,$(2)) $(3:%=$(OUT)/lib/lib%.so.$(VERSION))
	$$(call step,LINK)
	$$(Q)$$($(call linker,$(2))) $$(SAN) -shared -Wl,-soname,lib$(1).so.$(SOVERSION) $$(if $$(SAN),,-Wl,--no-undefined) $(if $(3),$$(ORIGIN)) -o $$@ $$(filter %.o,$$^) -L$(OUT)/lib $(3:%=-l%) $(4) -lm
	$$(Q)ln -sf $$(@F) $$(@D)/lib$(1).so.$(SOVERSION) && ln -sf lib$(1).so.$(SOVERSION) $$(@D)/lib$(1).so
endef
# $(call module,NAME,SOURCES,OUR LIBRARIES,FLAGS): build/lib/tensormass/NAME.so, opened on demand (libtensormass/platform/module.c).
module = $(eval MODULES += $(OUT)/lib/tensormass/$(1).so)$(eval $(call module_rule,$(1),$(2),$(3),$(4)))
define module_rule
$(OUT)/lib/tensormass/$(1).so: $(call objects,$(2)) $(call lib,$(3))
	$$(call step,LINK)
	$$(Q)$$($(call linker,$(2))) $$(SAN) -shared -o $$@ $$^ $(4) -lm
endef
# $(call executable,FILE IN build/,SOURCES,OUR LIBRARIES,FLAGS); $(call program,NAME,...): build/bin/NAME.
# $(call test,tests/DIR/test_x.c...,OTHER SOURCES,OUR LIBRARIES,FLAGS): build/tests/DIR/test_x, run by tests/test_programs.py (exit 0 pass, 77 skip).
executable = $(eval $(call executable_rule,$(1),$(2),$(3),$(4)))
program = $(eval PROGRAMS += $(OUT)/bin/$(1))$(call executable,bin/$(1),$(2),$(3),$(4))
test = $(foreach t,$(1),$(eval TESTS += $(OUT)/$(basename $(t)))$(call executable,$(basename $(t)),$(t) $(2) $(CASES),$(3),$(4) -lcmocka))
# Sanitizers' builds leave out some cases of a test, and the build for coverage runs each by itself.
CASES := $(if $(filter asan tsan coverage,$(config)),tests/sanitize/cases.c)
linker = $(if $(filter %.cpp,$(1)),CXX,CC)
define executable_rule
$(OUT)/$(1): $(call objects,$(2)) $(call lib,$(3))
	$$(call step,LINK)
	$$(Q)$$($(call linker,$(2))) $$(SAN) -rdynamic -o $$@ $(call objects,$(2)) -Wl,--start-group $(call lib,$(3)) -Wl,--end-group $(4) -ldl -lm -lpthread
endef
# $(call script,FILE IN build/,SOURCE): a Python program with its version filled in.
script = $(eval SCRIPTS += $(OUT)/$(1))$(eval $(OUT)/$(1): $(2))
# $(call ready,PACKAGE GROUPS,TARGETS): first line of a target that users type: installs what is missing, then builds.
define ready
@tools/setup.sh $(1)
@+$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$$(nproc)) $(2)
endef

# Only the fuzzing build checks the core for overflowing pointers: in its loops the check takes half of the time.
$(OUT)/obj/libtensormass/src/%.o: BASE_CFLAGS += $(if $(filter asan,$(config)),-fno-sanitize=pointer-overflow)
# With a sanitizer, code without the step's loops takes a third of the time to compile without optimisation.
QUICKLY := apps libtensormass/scene libtensormass/io libtensormass/platform haptic_rt/io haptic_rt/device haptic_rt/motion lcm_types
$(if $(filter asan tsan,$(config)),$(QUICKLY:%=$(OUT)/obj/%/%.o)): BASE_CFLAGS += -O0
# Threads share the same memory in every SIMD form of a law: ThreadSanitizer's build has only the plain one, to compile less.
$(if $(filter tsan,$(config)),$(OUT)/obj/libtensormass/src/material/%.o): BASE_CFLAGS += -DTM_PLAIN_ONLY
$(OUT)/obj/%.o: %.c Makefile
	$(call step,CC)
	$(Q)$(CC) $(BASE_CFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
$(OUT)/obj/%.o: %.cpp Makefile
	$(call step,CXX)
	$(Q)$(CXX) $(BASE_CXXFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
# Generated by lcm-gen: without our warnings, and without the check that LCM copies nothing from null (an array without elements).
$(OUT)/obj/%.o: $(OUT)/gen/%.c
	$(call step,CC)
	$(Q)$(CC) $(BASE_CFLAGS) -w $(if $(findstring undefined,$(OPT)),-fno-sanitize=nonnull-attribute) $(INCLUDES) -c $< -o $@

# Each folder's module.mk states what is built from it; a folder may be absent (the Python sources).
include $(wildcard $(addsuffix /module.mk,libtensormass lcm_types haptic_rt haptic_rt/firmware apps python web packaging plugins/mujoco tests tests/firmware tests/fuzz))
include tools/install.mk tools/site/site.mk
$(SCRIPTS): Makefile
	$(call step,COPY)
	$(Q)sed 's/@VERSION@/$(VERSION)/' $(filter-out Makefile,$^) > $@ && chmod 755 $@
# Python environments of single targets: build/NAME/venv from the target's file of requirements.
$(OUT)/%/venv/.done:
	@mkdir -p $(@D)
	@flock $(@D).lock sh -c '/usr/bin/python3 -m venv $(@D) && $(@D)/bin/pip install -q --disable-pip-version-check -r $^' || { echo "make: pip could not install what $^ names; check the network or the package index" >&2; exit 2; }
	@touch $@

# ---- targets ----

# Targets in `make help` are not files, though a folder may have the same name.
.PHONY: all programs tests help venv $(shell sed -n 's/^#: make \([a-z-]*\).*/\1/p' $(MAKEFILE_LIST))
all: programs
programs: $(PROGRAMS) $(MODULES) $(LIBRARIES) $(SCRIPTS)
tests: programs $(TESTS)
	@mkdir -p $(OUT)/tests
	@printf '%s\n' $(TESTS) > $(OUT)/tests/manifest.txt
# The tests' own sources, a quarter of the code, need not be fast, and with a sanitizer take a quarter of the time to compile without optimisation; the code
# under test is compiled as shipped.
$(TESTS:$(OUT)/%=$(OUT)/obj/%.o): BASE_CFLAGS += $(if $(filter asan tsan,$(config)),-O0,$(patsubst -O3,-O1,$(filter -O%,$(OPT)))) $(if $(filter coverage,$(config)),-fno-profile-instr-generate)
$(if $(CASES),$(TESTS)): SAN += -Wl,--wrap=_cmocka_run_group_tests

# Tests in the short form of `make sanitize` (tests/sanitize): under ThreadSanitizer the C programs that start threads, under AddressSanitizer those that
# left_out.txt does not name (docs/sanitizers.md).
THREADED := $(addprefix $(OUT)/tests/,cut/test_touch_threads loop/test_mailbox physics/test_partition physics/test_step_threads physics/test_threads $(addprefix solve/test_,arguments factored files organ static))
LEFT_OUT := $(shell awk 'NF == 1 && !/^\#/ {print $$1}' tests/sanitize/left_out.txt)
SHORT_TESTS := $(if $(filter tsan,$(config)),$(THREADED),$(if $(filter asan,$(config)),$(filter-out $(addprefix $(OUT)/tests/,$(LEFT_OUT)),$(TESTS)),$(TESTS)))
tests-short: $(SHORT_TESTS) $(addprefix $(OUT)/bin/,haptic-rt tm-device tm-sim) $(addprefix $(OUT)/lib/tensormass/,lcm.so solve.so) $(OUT)/python/tensormass_lcm/__init__.py
	@mkdir -p $(OUT)/tests && printf '%s\n' $(SHORT_TESTS) > $(OUT)/tests/manifest.txt

help:
	@sed -n 's/^#: //p' $(MAKEFILE_LIST) | awk -F '  +' '{ printf "%-31s %s\n", $$1, $$2 }'

#: make                        build programs and libraries into build/ (config=debug|asan|tsan|fuzz|clang into build/<config>/)
#: make setup                  install the Debian packages that building needs
setup:
	@tools/setup.sh build
venv: $(VENV)/.done
$(VENV)/.done: tools/requirements.txt
	@tools/setup.sh venv "$(VENV)"

#: make test                   build, run the quick tests, within a minute: at each save (ROOM=physics|system: another room, CONTRIBUTING.md)
ROOM ?= unit
test:
	@$(MAKE) --no-print-directory -j$$(nproc) venv tests
	@TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python tests/run.py --room $(ROOM) $(PYTEST_ARGS)
#: make check                  install what is missing, build, run every test (long ones in a short form)
#: make check-long             the counts and durations that the documentation quotes
check check-long:
	$(call ready,build demo check image,venv tests $(OUT)/lib/tensormass/image.so)
	@TM_LONG=$(if $(filter check-long,$@),1,$(TM_LONG)) TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python tests/run.py $(PYTEST_ARGS)

#: make clean                  remove build/
clean:
	rm -rf $(BUILD)

-include $(shell find $(OUT)/obj $(OUT)/tests/firmware $(BUILD)/firmware -name '*.d' 2>/dev/null)
