# tensormass. `make demo` and `make check` do everything, installing what is missing; `make help` lists the rest.
# config=release|debug|asan|tsan|fuzz|clang chooses the build; release goes to build/, the others to build/<config>/; V=1 shows command lines.

, := ,
config ?= release
BUILD ?= build
OUT := $(BUILD)$(if $(filter-out release,$(config)),/$(config))
VENV ?= $(BUILD)/venv
PREFIX ?= /usr/local
DESTDIR ?=
VERSION := 0.1.0
# What breaks the C interface: until 1.0 the second number, then the first (CONTRIBUTING.md).
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
CC := $(CC_$(config))
CXX := $(if $(filter gcc,$(CC)),g++,clang++)
$(if $(CC),,$(error config=$(config): no such build; use release, debug, asan, tsan, fuzz or clang))

OPT_release := -O3 -g -DNDEBUG
OPT_clang := -O3 -g -DNDEBUG
OPT_debug := -O0 -g
OPT_asan := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=undefined
OPT_tsan := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=thread
OPT_fuzz := -O1 -gline-tables-only -fno-omit-frame-pointer -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined
OPT := $(OPT_$(config))
# With a sanitizer the C++ library is there from the start: it must know its functions before a module brings C++ along.
SAN := $(filter -fsanitize%,$(OPT)) $(if $(filter -fsanitize%,$(OPT)),-Wl$(,)--push-state$(,)--no-as-needed -lstdc++ -Wl$(,)--pop-state)

# -ffp-contract=off: the plain form's bits must not depend on compiler or processor.
WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wconversion -Wno-sign-conversion $(if $(filter gcc,$(CC)),-Wno-format-truncation)
BASE_CFLAGS := -std=c11 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC -MMD -MP $(WARN)
# Two of the checks of C++ want a runtime that a C program is not linked with.
BASE_CXXFLAGS := -std=c++17 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC $(if $(findstring undefined,$(OPT)),-fno-sanitize=function$(,)vptr) -MMD -MP -Wall -Wextra
INCLUDES := -I. -Ilibtensormass/include -Ilibtensormass/io/include -Ilibtensormass/scene/include -Ilibtensormass/src -Ihaptic_rt/core -Ilibtensormass -Ilibtensormass/platform -Ihaptic_rt -Iapps -Iapps/common -Ilcm_types -I$(OUT)/gen

# Libraries that lean on others of ours find them beside themselves; packages for a system's own folder say ORIGIN= .
ORIGIN ?= -Wl,-rpath,'$$ORIGIN'

# Answers of pkg-config, asked only when a recipe needs them (they may be installed by the same make).
pkg_cflags = $(shell pkg-config --cflags $(1))
pkg_libs = $(shell pkg-config --libs $(1))

# One word and the file; V=1 shows whole command lines.
Q := $(if $(V),,@)
say = $(if $(V),,@printf '  %-5s %s\n' '$(1)' '$(patsubst $(BUILD)/%,%,$@)')
# Recipe of a .a from what it waits for.
define archive
@mkdir -p $(@D)
$(call say,AR)
$(Q)rm -f $@ && ar rcs $@ $^
endef

# $(call objects,SOURCES): their object files.
objects = $(patsubst %,$(OUT)/obj/%.o,$(basename $(1)))

# Programs that are not compiled, and their parts.
SCRIPTS :=
# $(eval $(call program,NAME,SOURCES,OTHER PREREQUISITES (.a/.o, linked),LIBRARY FLAGS)): build/bin/NAME.
PROGRAMS :=
define program
PROGRAMS += $(OUT)/bin/$(1)
$(OUT)/bin/$(1): $(call objects,$(2)) $(3)
	@mkdir -p $$(@D)
	$$(call say,LINK)
	$$(Q)$$(CC) $$(SAN) -rdynamic -o $$@ $$(call objects,$(2)) -Wl,--start-group $(3) -Wl,--end-group $(4) -ldl -lm -lpthread
endef

# $(eval $(call module,NAME,SOURCES,OTHER PREREQUISITES,LIBRARY FLAGS)): build/lib/tensormass/NAME.so, opened on demand (libtensormass/platform/module.c).
MODULES :=
define module
MODULES += $(OUT)/lib/tensormass/$(1).so
$(OUT)/lib/tensormass/$(1).so: $(call objects,$(2)) $(3)
	@mkdir -p $$(@D)
	$$(call say,LINK)
	$$(Q)$$(if $$(filter %.cpp,$(2)),$$(CXX),$$(CC)) $$(SAN) -shared -o $$@ $$(call objects,$(2)) $(3) $(4) -lm
endef

# $(eval $(call test,tests/DIR/test_x.c,PREREQUISITES,FLAGS)): build/tests/DIR/test_x, run by tests/test_programs.py (exit 0 pass, 77 skip).
TESTS :=
define test
TESTS += $(OUT)/$(basename $(1))
$(OUT)/$(basename $(1)): $(call objects,$(1)) $(2)
	@mkdir -p $$(@D)
	$$(call say,LINK)
	$$(Q)$$(CC) $$(SAN) -rdynamic -o $$@ $$(call objects,$(1)) -Wl,--start-group $(2) -Wl,--end-group $(3) -lcmocka -ldl -lm -lpthread
endef

# Pointers that wrap are looked for by the fuzzing build in the core too: in its loops it is half of their time.
$(OUT)/obj/libtensormass/src/%.o: BASE_CFLAGS += $(if $(filter asan,$(config)),-fno-sanitize=pointer-overflow)
$(OUT)/obj/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(BASE_CFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
$(OUT)/obj/%.o: %.cpp Makefile
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(CXX) $(BASE_CXXFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
# Generated by lcm-gen: not ours to warn about, nor that LCM copies nothing from nowhere (an array of no elements).
$(OUT)/obj/%.o: $(OUT)/gen/%.c
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(BASE_CFLAGS) -w $(if $(findstring undefined,$(OPT)),-fno-sanitize=nonnull-attribute) $(INCLUDES) -c $< -o $@

# What other programs link comes first.
APPS_FIRST := $(wildcard apps/common/module.mk) $(wildcard apps/sim/module.mk) $(wildcard apps/studies/replay/module.mk)
# Each folder says in its module.mk what is built from it.
MODULE_MK := $(sort $(wildcard libtensormass/module.mk libtensormass/*/module.mk lcm_types/module.mk haptic_rt/module.mk \
	haptic_rt/*/module.mk)) $(APPS_FIRST) \
	$(sort $(filter-out $(APPS_FIRST),$(wildcard apps/*/module.mk apps/*/*/module.mk))) $(sort $(wildcard tests/module.mk tests/*/module.mk)) \
	$(wildcard python/module.mk packaging/module.mk plugins/*/module.mk)
include $(MODULE_MK)
include tools/install.mk
include tools/site/site.mk

# ---- targets ----

.PHONY: all programs tests tests-short help clean setup venv test check check-long check-run
all: programs
programs: $(PROGRAMS) $(MODULES) $(LIBRARIES) $(SCRIPTS)
tests: programs $(TESTS)
	@mkdir -p $(OUT)/tests
	@printf '%s\n' $(TESTS) > $(OUT)/tests/manifest.txt
# The tests' own sources, a quarter of all, need not be quick; what they call is as it ships.
$(TESTS:$(OUT)/%=$(OUT)/obj/%.o): BASE_CFLAGS += $(patsubst -O3,-O1,$(filter -O%,$(OPT)))

# What the short form of `make sanitize` runs (tests/sanitize): of the C programs under ThreadSanitizer those that start threads, under AddressSanitizer all but
# the longest, whose code others run too.
THREADED := $(addprefix $(OUT)/tests/,loop/test_mailbox physics/test_borders physics/test_step_threads physics/test_threads $(addprefix solve/test_,arguments factored files organ static))
LONGEST := $(addprefix $(OUT)/tests/,physics/test_step_threads physics/test_windows sim/test_transitions solve/test_online solve/test_sent)
SHORT_TESTS := $(if $(filter tsan,$(config)),$(THREADED),$(filter-out $(LONGEST),$(TESTS)))
tests-short: $(SHORT_TESTS) $(addprefix $(OUT)/bin/,haptic-rt tm-device tm-sim) $(addprefix $(OUT)/lib/tensormass/,lcm.so solve.so) $(OUT)/python/tensormass_lcm/__init__.py
	@printf '%s\n' $(SHORT_TESTS) > $(OUT)/tests/manifest.txt

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
	@tools/setup.sh build demo check image
	@$(MAKE) --no-print-directory -j$$(nproc) venv tests $(IMAGE_SO)
	@TM_LONG=$(if $(filter check-long,$@),1,$(TM_LONG)) $(MAKE) --no-print-directory check-run
check-run:
	@TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python tests/run.py $(PYTEST_ARGS)

#: make clean                  remove build/
clean:
	rm -rf $(BUILD)

-include $(shell find $(OUT)/obj -name '*.d' 2>/dev/null)
