# The libraries: build/lib/libNAME.a and .so. The core needs only libc and libm; the file reader, scenes and solvers depend on it.
$(call library,platform,$(call files,libtensormass/platform/*.c))
$(call shared,tensormass,$(call files,libtensormass/src/*/*.c))
$(call shared,tensormass_io,$(call files,libtensormass/io/*.c),tensormass)

# Scenes: also contains the devices, kinematics of joints, scripted hands and output files.
SCENE_SRC := $(call files,libtensormass/scene/*.c) $(call files,haptic_rt/motion/*.c) haptic_rt/core/kinematics.c libtensormass/platform/output.c
$(call shared,tensormass_scene,$(SCENE_SRC),tensormass_io tensormass,-Wl$(,)-Bsymbolic -lyaml -ldl)
$(call objects,libtensormass/scene/module_open.c): BASE_CFLAGS += -DTM_SOVERSION='"$(SOVERSION)"'

# Precomputed and hybrid models. Also built as a module that is opened if a scene needs it; the core's functions come from the program.
SOLVE_SRC := $(call files,libtensormass/solve/*.c libtensormass/solve/*.cpp)
SOLVE_LD := -lcholmod -lsuitesparseconfig -lblas -lstdc++ -lpthread
$(call shared,tensormass_solve,$(SOLVE_SRC),tensormass,$(SOLVE_LD))
$(call module,solve,$(SOLVE_SRC),,$(SOLVE_LD))
$(call objects,$(SOLVE_SRC)): INCLUDES += -I/usr/include/suitesparse -isystem /usr/include/eigen3
# Eigen's templates: line numbers only for a debugger, and no checks of their undefined behaviour, which take half of the compile time.
$(call objects,$(filter %.cpp,$(SOLVE_SRC))): BASE_CXXFLAGS += $(if $(SAN),-fno-sanitize=undefined,-g1)
