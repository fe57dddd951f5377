# The generated meshes. 1k and 10k are committed (tests compare them with what the generator makes); `make meshes` adds the 50k ones in build/meshes.
MESH_GROWING := apps/mesh/growing.c apps/mesh/bisect.c apps/mesh/improve.c apps/mesh/lattice.c
MESH_GENERATOR := $(OUT)/obj/meshes/generate
MESHES_50K := $(foreach s,block cylinder liver,$(OUT)/meshes/$(s)_50k.msh)
$(MESH_GENERATOR): $(call objects,$(sort $(wildcard meshes/generator/*.c)) $(MESH_GROWING))
	@mkdir -p $(@D)
	$(CC) $(SAN) -o $@ $^ -lm
$(OUT)/meshes/%_50k.msh: $(MESH_GENERATOR)
	@mkdir -p $(@D)
	$(MESH_GENERATOR) $* 50000 $(basename $@)
.PHONY: meshes meshes-committed
meshes: $(MESHES_50K)
# Makes the committed meshes anew.
meshes-committed: $(MESH_GENERATOR)
	for s in block cylinder liver; do $(MESH_GENERATOR) $$s 1000 meshes/$${s}_1k && $(MESH_GENERATOR) $$s 10000 meshes/$${s}_10k || exit 1; done
