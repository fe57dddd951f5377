# tm-sim, and what it is made of (libsim.a) for programs that run a scene with controllers themselves.
SIM_SRC := $(sort $(filter-out apps/sim/main.c,$(wildcard apps/sim/*.c)))
LIBSIM_A := $(OUT)/lib/libsim.a
LIBRARIES += $(LIBSIM_A)
$(LIBSIM_A): $(call objects,$(SIM_SRC))
	$(archive)
SIM_LIBS = $(LIBSIM_A) $(SCENE_LIBS) $(LIBHRT_DEVICE_A) $(LIBHRT_IO_A) $(LIBHRT_A) $(LIBLCMTYPES_A)
$(eval $(call program,tm-sim,apps/sim/main.c,$(SIM_LIBS),-lyaml -lcjson))
