# Builds the libFuzzer targets. `make fuzz` builds all with clang for coverage (config=fuzz) and runs each for FUZZ_SECONDS. make check links them to the
# AddressSanitizer build (config=asan), which it needs anyway, and runs each for some thousand inputs: the seeds and unguided mutations.
FUZZ_SECONDS ?= 60
#: make fuzz FUZZ_SECONDS=60   fuzz every parser and decoder, so many processor seconds each: build/fuzz/fuzz.json, findings in build/fuzz/findings/
ifneq ($(config),fuzz)
fuzz $(if $(filter-out asan,$(config)),fuzz-programs):
	@$(MAKE) --no-print-directory config=fuzz $@
else
fuzz:
	$(call ready,build check,venv fuzz-programs)
	$(VENV)/bin/python tests/fuzz/run.py --build $(OUT) --seconds $(FUZZ_SECONDS) $(FUZZ_ARGS)
endif

ifneq ($(filter fuzz asan,$(config)),)
# $(call fuzzer,NAMES,OTHER SOURCES,OUR LIBRARIES,FLAGS): with libFuzzer's main.
fuzzer = $(foreach f,$(1),$(call executable,tests/fuzz/$(f),tests/fuzz/$(f).c $(2),$(3),$(4))$(eval fuzz-programs: $(OUT)/tests/fuzz/$(f)))
$(call fuzzer,fuzz_mesh fuzz_mesh_text,,$(APP_LIBS) tensormass)
$(call fuzzer,fuzz_snapshot,,tensormass)
$(call fuzzer,fuzz_responses fuzz_calls,,tensormass_solve tensormass,$(SOLVE_LD))
$(call fuzzer,fuzz_can fuzz_sample,,$(DEVICE_LIBS))
$(call fuzzer,fuzz_lcm,,lcm_types $(DEVICE_LIBS))
$(call fuzzer,fuzz_receiver,,lcm_types,-llcm)
$(call fuzzer,fuzz_scene,,$(SIM_LIBS),-lyaml -lcjson)
$(call fuzzer,fuzz_tables,haptic_rt/device/hand_file.c haptic_rt/io/samples.c apps/mesh/signed_distance.c apps/mesh/signed_distance_stl.c,$(DEVICE_LIBS) $(SCENE_LIBS),-lyaml)
$(OUT)/tests/fuzz/%: SAN := $(filter-out -fsanitize=fuzzer-no-link%,$(SAN)) -fsanitize=fuzzer,address,undefined
# Separate objects: libFuzzer must instrument at least the target itself.
FUZZ_OBJ := $(call objects,$(wildcard tests/fuzz/*.c))
$(FUZZ_OBJ): INCLUDES += -Ihaptic_rt/io
$(FUZZ_OBJ): BASE_CFLAGS += -fsanitize=fuzzer-no-link
# LCM's header calls memcpy with null for an empty array.
$(OUT)/obj/lcm_types/%.o: BASE_CFLAGS += -fno-sanitize=nonnull-attribute
endif
