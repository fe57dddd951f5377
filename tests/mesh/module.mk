# Mesh files, tm-mesh and the generated meshes.
$(eval $(call test,tests/mesh/test_mesh_io.c,$(LIBAPP_A) $(LIBTM_A),))
$(eval $(call test,tests/mesh/test_image_volumes.c,$(call objects,$(addprefix apps/mesh/,bisect.c growing.c image_volumes.c improve.c)) $(LIBTM_A),))
tests: $(MESH_GENERATOR)
