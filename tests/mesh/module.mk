# Mesh files, tm-mesh and the generated meshes.
$(foreach t,$(sort $(wildcard tests/mesh/test_*.c)),$(eval $(call test,$(t),$(LIBAPP_A) $(LIBTM_A),)))
tests: $(MESH_GENERATOR)
