# gmsh.so: Gmsh's reader and mesher, opened only by a mesh that is in no cache.
$(eval $(call module,gmsh,$(sort $(wildcard apps/mesh/gmsh_*.c)),$(LIBAPP_A) $(LIBTM_A),-lgmsh))
