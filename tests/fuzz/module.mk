# libFuzzer targets. `make fuzz` builds all with clang for coverage (config=fuzz) and runs each for FUZZ_SECONDS; make check links them to the build of
# AddressSanitizer (config=asan), which is there anyway, and runs each for some thousand inputs: the seeds, and mutations that nothing guides.
FUZZ_SECONDS ?= 60
.PHONY: fuzz fuzz-programs fuzz-run
#: make fuzz FUZZ_SECONDS=60   fuzz every parser and decoder, so many processor seconds each: build/fuzz/fuzz.json, findings in build/fuzz/findings/
ifneq ($(config),fuzz)
fuzz fuzz-run:
	@$(MAKE) --no-print-directory config=fuzz $@
else
fuzz:
	@tools/setup.sh build check
	@$(MAKE) --no-print-directory venv
	@$(MAKE) --no-print-directory -j$$(nproc) fuzz-programs
	@$(MAKE) --no-print-directory fuzz-run
fuzz-run:
	$(VENV)/bin/python tests/fuzz/run.py --build $(OUT) --seconds $(FUZZ_SECONDS) $(FUZZ_ARGS)
endif

ifneq ($(filter fuzz asan,$(config)),)
# $(eval $(call fuzzer,NAME,OTHER SOURCES,LIBRARIES,FLAGS))
FUZZERS :=
define fuzzer
FUZZERS += $(OUT)/tests/fuzz/$(1)
$(OUT)/tests/fuzz/$(1): $(call objects,tests/fuzz/$(1).c $(2)) $(3)
	@mkdir -p $$(@D)
	$$(call say,LINK)
	$$(Q)$$(CC) $$(filter-out -fsanitize=fuzzer-no-link%,$$(SAN)) -fsanitize=fuzzer,address,undefined -rdynamic -o $$@ $$(call objects,tests/fuzz/$(1).c $(2)) \
		-Wl,--start-group $(3) -Wl,--end-group $(4) -ldl -lm -lpthread
endef
FUZZ_HRT := $(LIBHRT_DEVICE_A) $(LIBHRT_IO_A) $(LIBHRT_A)
$(eval $(call fuzzer,fuzz_mesh,,$(LIBAPP_A) $(LIBTM_A),))
$(eval $(call fuzzer,fuzz_mesh_text,,$(LIBAPP_A) $(LIBTM_A),))
$(eval $(call fuzzer,fuzz_snapshot,,$(LIBTM_A),))
$(eval $(call fuzzer,fuzz_responses,,$(LIBTMS_A) $(LIBTM_A),$(TMS_LIBS)))
$(eval $(call fuzzer,fuzz_calls,,$(LIBTMS_A) $(LIBTM_A),$(TMS_LIBS)))
$(eval $(call fuzzer,fuzz_can,,$(FUZZ_HRT),))
$(eval $(call fuzzer,fuzz_lcm,,$(LIBLCMTYPES_A) $(FUZZ_HRT),))
$(eval $(call fuzzer,fuzz_receiver,,$(LIBLCMTYPES_A),-llcm))
$(eval $(call fuzzer,fuzz_sample,,$(FUZZ_HRT),))
$(eval $(call fuzzer,fuzz_scene,,$(SIM_LIBS) $(LIBLCMTYPES_A),-lyaml -lcjson))
$(eval $(call fuzzer,fuzz_tables,haptic_rt/device/hand_file.c haptic_rt/io/samples.c apps/mesh/shell.c apps/mesh/shell_stl.c,$(FUZZ_HRT) $(SCENE_LIBS),-lyaml))
$(call objects,$(wildcard tests/fuzz/*.c)): INCLUDES += -Ihaptic_rt/io
# libFuzzer wants to see at least the target itself.
$(call objects,$(wildcard tests/fuzz/*.c)): BASE_CFLAGS += -fsanitize=fuzzer-no-link
# LCM's own header copies nothing to null for an empty array.
$(OUT)/obj/lcm_types/%.o: BASE_CFLAGS += -fno-sanitize=nonnull-attribute
fuzz-programs: $(FUZZERS)
else
fuzz-programs:
	@$(MAKE) --no-print-directory config=fuzz $@
endif
