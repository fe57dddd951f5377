# C tests are cmocka programs, one per file; Python tests run the programs as a user does. pytest runs both.
# TM_LONG=1 (make check-long) makes tests run the counts and durations that docs quote.
tests_of = $(call files,tests/$(1)/test_*.c)
$(call test,$(call tests_of,unit) $(call tests_of,physics),,tensormass)
$(call test,$(call tests_of,apps),haptic_rt/io/loop.c,$(DEVICE_LIBS) $(APP_LIBS) tensormass,-lcjson)
$(call test,$(call tests_of,cut),,$(APP_LIBS) tensormass)
$(call test,$(call tests_of,loop),,$(DEVICE_LIBS) lcm_types tensormass)
$(call test,$(call tests_of,sim),,replay $(SIM_LIBS),-lyaml -lcjson)
$(call test,$(call tests_of,solve),,$(APP_LIBS) tensormass_solve tensormass,$(SOLVE_LD))
$(call test,$(call tests_of,trust),,lcm_types $(APP_LIBS) tensormass,-llcm)
$(call test,tests/accuracy/test_pace.c,apps/studies/accuracy/machine_speed.c,$(APP_LIBS))
$(call test,tests/accuracy/test_limit.c,apps/studies/accuracy/study_time.c,$(SIM_LIBS),-lyaml -lcjson)
$(call test,tests/accuracy/test_yaml.c,apps/studies/accuracy/study_yaml.c,$(SIM_LIBS),-lyaml -lcjson)
$(call test,tests/mesh/test_mesh_io.c,,$(APP_LIBS) tensormass)
$(call test,tests/mesh/test_image_volumes.c,$(patsubst %,apps/mesh/%.c,bisect mesh_builder image_volumes improve),tensormass)
$(call test,tests/mesh/test_shell.c,$(patsubst %,apps/mesh/%.c,bisect mesh_builder improve signed_distance signed_distance_stl),$(APP_LIBS) tensormass)
# The child process of the module 'image': this file alone of the module needs no library.
$(call test,tests/mesh/test_box.cpp,apps/image/box.cpp)
$(call test,tests/view/test_skin.c tests/view/test_fairing.c,$(patsubst %,apps/view/%.c,fairing picture reference cut_outline surface_smoothing))
$(call test,tests/view/test_controls.c,apps/play/controls.c apps/view/camera.c,hrt)
$(call test,tests/view/test_marks.c,$(patsubst %,apps/view/%.c,camera layout marks marks_find picture shapes))
$(call objects,$(call tests_of,loop)): CFLAGS_EXTRA += -Wno-float-conversion
$(call objects,tests/solve/test_static.c): INCLUDES += -I/usr/include/suitesparse

# Programs for Python tests: cost of a step; tm-mesh for many files in one process; libraries that shift a process's clocks or count its allocations; the codec alone.
$(call executable,tests/effects/plain_step,tests/effects/plain_step.c,tensormass,-lcmocka)
$(call executable,tests/effects/body_effects,tests/effects/body_effects.c,tensormass,-lcmocka)
$(call executable,tests/many_files,tests/mesh/many_files.c $(filter-out apps/mesh/main.c,$(call files,apps/mesh/*.c)),tensormass_scene $(APP_LIBS) tensormass,-lcjson)
PRELOADED := $(patsubst %,$(OUT)/tests/%.so,loop/fake_clock sim/fail_calloc timing/count_malloc)
$(PRELOADED): $(OUT)/%.so: %.c
	$(call step,LINK)
	$(Q)$(CC) -shared -fPIC -O1 -Wall -fno-builtin -o $@ $< -ldl
$(OUT)/tests/can/codec.so: haptic_rt/can/codec.c haptic_rt/can/codec.h
	$(call step,LINK)
	$(Q)$(CC) -shared -fPIC -O1 $(INCLUDES) -o $@ $(filter %.c,$^)
tests: $(patsubst %,$(OUT)/tests/%,effects/plain_step effects/body_effects many_files bench/bench can/codec.so) $(MESH_GENERATOR) $(PRELOADED)

# ---- benchmarks: assert nothing ----

measured = TM_COMMIT=$$(git rev-parse --short HEAD 2>/dev/null) TM_FLAGS='$(OPT) -ffp-contract=off'

# Costs of a force pass, a step and a removed tetrahedron, with this machine's memory bandwidth in the same run.
$(call executable,tests/bench/bench,$(call files,tests/bench/*.c),$(APP_LIBS) tensormass_solve tensormass,$(SOLVE_LD) -lcjson)
$(call executable,tests/solve/bench_models,tests/solve/bench_models.c,$(APP_LIBS) tensormass_solve tensormass,$(SOLVE_LD) -lcmocka -lcjson)
# The plain loop again, compiled for the instructions of the best form.
ifeq ($(shell $(CC) -dumpmachine | cut -d- -f1),x86_64)
$(OUT)/obj/tests/bench/naive_wide.o: BASE_CFLAGS += -mavx2 -mfma -ffp-contract=fast
endif
#: make bench                  cost per edge, step and removed tetrahedron: build/bench/bench.json (QUICK=1: the short form; BASELINE=old.json: what has become slower, exit 1)
bench: bench-timing
	$(call ready,build,$(OUT)/tests/bench/bench)
	@mkdir -p $(OUT)/bench
	$(measured) $(OUT)/tests/bench/bench $(if $(QUICK),--quick) --json $(OUT)/bench/bench.json
	$(if $(BASELINE),$(VENV)/bin/python tests/bench/compare.py $(BASELINE) $(OUT)/bench/bench.json)
#: make bench-models           cost of precomputing against mesh size, and of one update on line: build/bench/models.json (QUICK=1: the small organ)
bench-models: $(OUT)/tests/solve/bench_models
	@mkdir -p $(OUT)/bench
	$(measured) $< $(OUT)/bench/models.json $(if $(QUICK),--quick)
#: make bench-timing           lateness of haptic-rt beside cyclictest, idle and busy: build/bench/timing.json (part of make bench; QUICK=1: the short form)
bench-timing:
	$(call ready,build check,programs venv)
	@mkdir -p $(OUT)/bench
	$(VENV)/bin/python tests/timing/timing.py $(if $(QUICK),--quick) --bin $(OUT)/bin --json $(OUT)/bench/timing.json
# The same press in other programs (docs/compared.md): MuJoCo and Newton of PyPI in separate environments, ours from the wheel. Programs that pip cannot install are missing in the table.
#: make compare                the same press in MuJoCo's flex and Newton (from PyPI), beside ours: error against time in build/compare/ (ARGS="--help")
COMPARE := $(abspath $(OUT))/compare
compare-venv:
	@$(MAKE) --no-print-directory $(OUT)/compare/venv/.done || echo "make compare: what is not there is left out" >&2
$(OUT)/compare/venv/.done: tests/compare/requirements.txt
compare: wheel compare-venv venv
	@rm -rf $(COMPARE)/python && $(VENV)/bin/python -m zipfile -e $(OUT)/wheel/*linux*_$$(uname -m).whl $(COMPARE)/python
	@$(VENV)/bin/python tests/compare/compare.py --out $(COMPARE) --ours $(COMPARE)/python --peers $(COMPARE)/venv/bin/python $(ARGS)

# ---- not part of make check ----

#: make check-can            haptic-rt and tm-device over a real kernel's CAN, in a guest
guest-kernel:
	@tools/setup.sh build check
	@tests/can/guest/kernel.sh $(BUILD)/guest
pytest_of = TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python -m pytest tests/$(1) -q -p no:cacheprovider $(PYTEST_ARGS)
check-can:
	$(call ready,build check,programs venv guest-kernel $(OUT)/tests/can/codec.so)
	$(call pytest_of,can)
#: make sanitize               the suite under ASan+UBSan and under TSan: build/sanitize.json, reports in build/{asan,tsan}/reports/
SANITIZERS ?= asan tsan
sanitize:
	$(call ready,build demo check,venv)
	@for s in $(SANITIZERS); do $(MAKE) --no-print-directory config=$$s -j$$(nproc) tests || exit; done
	$(VENV)/bin/python tests/sanitize/run.py --build $(BUILD) $(foreach a,$(PYTEST_ARGS),--pytest=$(a)) $(SANITIZERS)
#: make sanitize-choice        choose the C tests' cases that the short form under AddressSanitizer leaves out: tests/sanitize/left_out.txt
sanitize-choice:
	$(call ready,build check,venv)
	@$(MAKE) --no-print-directory config=coverage -j$$(nproc) tests-short
	$(VENV)/bin/python tests/sanitize/choose.py --build $(BUILD)/coverage
# Compiler and flags of a build, for tests that compile a file.
print-flags:
	@echo $(CC) $(OPT)
