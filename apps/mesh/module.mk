# gmsh.so: Gmsh's reader, opened only for a mesh that is in no cache. tm-mesh looks at meshes, mends and refines them.
$(eval $(call module,gmsh,$(sort $(wildcard apps/mesh/gmsh_*.c)),$(LIBAPP_A) $(LIBTM_A),-lgmsh))
$(eval $(call program,tm-mesh,$(filter-out apps/mesh/gmsh_%,$(sort $(wildcard apps/mesh/*.c))),$(LIBAPP_A) $(LIBTM_A),-lcjson))
