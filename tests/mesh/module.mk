# Mesh files, tm-mesh and the generated meshes.
$(eval $(call test,tests/mesh/test_mesh_io.c,$(LIBAPP_A) $(LIBTM_A),))
$(eval $(call test,tests/mesh/test_image_volumes.c,$(call objects,$(addprefix apps/mesh/,bisect.c growing.c image_volumes.c improve.c)) $(LIBTM_A),))
$(eval $(call test,tests/mesh/test_shell.c,$(call objects,$(addprefix apps/mesh/,bisect.c growing.c improve.c shell.c shell_stl.c)) $(LIBAPP_A) $(LIBTM_A),))
tests: $(MESH_GENERATOR)
# tm-mesh for thousands of files in one process (test_mutated.py); beside build/lib, where modules are looked for.
MANY_FILES := $(OUT)/tests/many_files
MANY_FILES_OBJ := $(call objects,tests/mesh/many_files.c $(filter-out apps/mesh/main.c,$(sort $(wildcard apps/mesh/*.c))))
$(MANY_FILES): $(MANY_FILES_OBJ) $(LIBTMSCENE_A) $(LIBAPP_A) $(LIBTM_A)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -rdynamic -o $@ $(MANY_FILES_OBJ) -Wl,--start-group $(LIBTMSCENE_A) $(LIBAPP_A) $(LIBTM_A) -Wl,--end-group -lcjson -ldl -lm -lpthread
tests: $(MANY_FILES)
# The child of the module 'image': of that module this file alone, which needs no library.
TEST_BOX := $(OUT)/tests/mesh/test_box
TESTS += $(TEST_BOX)
$(TEST_BOX): $(call objects,tests/mesh/test_box.cpp apps/image/box.cpp)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CXX) $(SAN) -rdynamic -o $@ $^ -lcmocka
