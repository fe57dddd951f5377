# tm-precompute, and with Open MPI (MPI=1, the default where mpicc is) tm-precompute-mpi.
$(eval $(call program,tm-precompute,apps/precompute/main.c apps/precompute/team_alone.c,$(SIM_LIBS),-lyaml -lcjson))
MPI ?= $(if $(shell command -v mpicc),1,0)
ifeq ($(MPI),1)
$(call objects,apps/precompute/team_mpi.c): INCLUDES += $(call pkg_cflags,ompi-c)
$(eval $(call program,tm-precompute-mpi,apps/precompute/main.c apps/precompute/team_mpi.c,$(SIM_LIBS),-lyaml -lcjson $(call pkg_libs,ompi-c)))
endif
