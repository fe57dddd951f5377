# tensormass. `make demo` and `make check` do everything, installing what is missing; `make help` lists the rest.
# config=release|debug|asan|tsan|fuzz|clang chooses the build; release goes to build/, the others to build/<config>/.

config ?= release
BUILD ?= build
OUT := $(BUILD)$(if $(filter-out release,$(config)),/$(config))
VENV ?= $(BUILD)/venv
PREFIX ?= /usr/local
DESTDIR ?=
VERSION := 0.1.0

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
OPT_asan := -O1 -g -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=undefined
OPT_tsan := -O1 -g -fno-omit-frame-pointer -fsanitize=thread
OPT_fuzz := -O1 -g -fno-omit-frame-pointer -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=undefined
OPT := $(OPT_$(config))
SAN := $(filter -fsanitize%,$(OPT))

# -ffp-contract=off: the plain form's bits must not depend on compiler or processor.
WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wconversion -Wno-sign-conversion $(if $(CI),-Werror)
BASE_CFLAGS := -std=c11 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC -MMD -MP $(WARN)
BASE_CXXFLAGS := -std=c++17 -D_GNU_SOURCE $(OPT) -ffp-contract=off -fno-math-errno -fvisibility=hidden -fPIC -MMD -MP -Wall -Wextra
INCLUDES := -Ilibtensormass/include -Ihaptic_rt/core -Ihaptic_rt -Iapps -Iapps/common -I$(OUT)/gen

# Answers of pkg-config, asked only when a recipe needs them (they may be installed by the same make).
pkg_cflags = $(shell pkg-config --cflags $(1))
pkg_libs = $(shell pkg-config --libs $(1))

# $(call objects,SOURCES): their object files.
objects = $(patsubst %,$(OUT)/obj/%.o,$(basename $(1)))

# $(eval $(call program,NAME,SOURCES,OTHER PREREQUISITES (.a/.o, linked),LIBRARY FLAGS)): build/bin/NAME.
PROGRAMS :=
define program
PROGRAMS += $(OUT)/bin/$(1)
$(OUT)/bin/$(1): $(call objects,$(2)) $(3)
	@mkdir -p $$(@D)
	$$(CC) $$(SAN) -rdynamic -o $$@ $$(call objects,$(2)) -Wl,--start-group $(3) -Wl,--end-group $(4) -ldl -lm -lpthread
endef

# $(eval $(call module,NAME,SOURCES,OTHER PREREQUISITES,LIBRARY FLAGS)): build/lib/tensormass/NAME.so, opened on demand (apps/common/module.c).
MODULES :=
define module
MODULES += $(OUT)/lib/tensormass/$(1).so
$(OUT)/lib/tensormass/$(1).so: $(call objects,$(2)) $(3)
	@mkdir -p $$(@D)
	$$(if $$(filter %.cpp,$(2)),$$(CXX),$$(CC)) $$(SAN) -shared -o $$@ $$(call objects,$(2)) $(3) $(4) -lm
endef

# $(eval $(call test,tests/DIR/test_x.c,PREREQUISITES,FLAGS)): build/tests/DIR/test_x, run by tests/test_programs.py (exit 0 pass, 77 skip).
TESTS :=
define test
TESTS += $(OUT)/$(basename $(1))
$(OUT)/$(basename $(1)): $(call objects,$(1)) $(2)
	@mkdir -p $$(@D)
	$$(CC) $$(SAN) -rdynamic -o $$@ $$(call objects,$(1)) -Wl,--start-group $(2) -Wl,--end-group $(3) -lcmocka -ldl -lm -lpthread
endef

$(OUT)/obj/%.o: %.c $(MAKEFILE_LIST)
	@mkdir -p $(@D)
	$(CC) $(BASE_CFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
$(OUT)/obj/%.o: %.cpp $(MAKEFILE_LIST)
	@mkdir -p $(@D)
	$(CXX) $(BASE_CXXFLAGS) $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@
$(OUT)/obj/%.o: $(OUT)/gen/%.c
	@mkdir -p $(@D)
	$(CC) $(BASE_CFLAGS) -Wno-conversion -Wno-missing-prototypes $(INCLUDES) $(CFLAGS_EXTRA) -c $< -o $@

# Each folder says in its module.mk what is built from it.
MODULE_MK := $(sort $(wildcard libtensormass/module.mk libtensormass/*/module.mk lcm_types/module.mk haptic_rt/module.mk \
	haptic_rt/*/module.mk meshes/module.mk)) $(sort $(wildcard apps/common/module.mk)) \
	$(sort $(filter-out apps/common/module.mk,$(wildcard apps/*/module.mk))) $(sort $(wildcard tests/module.mk tests/*/module.mk))
include $(MODULE_MK)

.PHONY: all programs tests help clean distclean setup setup-build
setup-build:
	@tools/setup.sh build
all: programs
programs: $(PROGRAMS) $(MODULES) $(LIBRARIES)
tests: programs $(TESTS)
	@printf '%s\n' $(TESTS) > $(OUT)/tests/manifest.txt

venv: $(VENV)/.done
$(VENV)/.done: tools/requirements.txt
	@tools/setup.sh venv "$(VENV)"

clean:
	rm -rf $(BUILD)

-include $(shell find $(OUT)/obj -name '*.d' 2>/dev/null)
