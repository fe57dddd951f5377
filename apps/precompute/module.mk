# tm-precompute, and with Open MPI (MPI=1, the default where mpicc is) tm-precompute-mpi, whose ranks share one factor with MUMPS (MUMPS=1, the default where its header is).
$(eval $(call program,tm-precompute,apps/precompute/main.c apps/precompute/team_alone.c,$(SCENE_LIBS),-lyaml -lcjson))
MPI ?= $(if $(shell command -v mpicc),1,0)
ifeq ($(MPI),1)
MUMPS ?= $(if $(shell $(CC) -include dmumps_c.h -E -x c /dev/null 2>/dev/null | grep -m1 DMUMPS_STRUC_C),1,0)
MUMPS := $(MUMPS)
SHARED_SRC := apps/precompute/shared_$(if $(filter 1,$(MUMPS)),mumps,none).c
$(call objects,apps/precompute/team_mpi.c $(SHARED_SRC)): INCLUDES += $(call pkg_cflags,ompi-c)
$(eval $(call program,tm-precompute-mpi,apps/precompute/main.c apps/precompute/team_mpi.c $(SHARED_SRC),$(SCENE_LIBS),-lyaml -lcjson $(call pkg_libs,ompi-c) $(if $(filter 1,$(MUMPS)),-ldmumps)))
# Linked anew when MUMPS came or went since it was built: what is only missing (.SECONDARY) makes nothing anew.
MUMPS_STAMP := $(OUT)/obj/apps/precompute/mumps
ifneq ($(if $(wildcard $(MUMPS_STAMP)),$(file <$(MUMPS_STAMP))),$(MUMPS))
$(shell mkdir -p $(dir $(MUMPS_STAMP)) && echo $(MUMPS) >$(MUMPS_STAMP))
endif
$(OUT)/bin/tm-precompute-mpi: $(MUMPS_STAMP)
endif
