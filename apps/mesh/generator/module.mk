#: make meshes               the generated meshes of 50,000 tetrahedra, into build/meshes/
# The generated meshes. 1k and 10k are committed (tests compare them with what the generator makes); `make meshes` adds the 50k ones in build/meshes.
MESH_GROWING := apps/mesh/growing.c apps/mesh/bisect.c apps/mesh/improve.c apps/mesh/lattice.c
MESH_GENERATOR := $(OUT)/obj/apps/mesh/generate
MESHES_DIR ?= $(OUT)/meshes
MESHES_50K := $(foreach s,block cylinder liver,$(MESHES_DIR)/$(s)_50k.msh)
$(MESH_GENERATOR): $(call objects,$(sort $(wildcard apps/mesh/generator/*.c)) $(MESH_GROWING))
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -o $@ $^ -lm
$(MESHES_DIR)/%_50k.msh: $(MESH_GENERATOR)
	@mkdir -p $(@D)
	$(MESH_GENERATOR) $* 50000 $(basename $@)
.PHONY: meshes meshes-committed
meshes: $(MESHES_50K)
# Makes the committed meshes anew. liver_cut is finer where the demo cuts: the front margin of the left lobe; renumbered,
# for what refining adds is numbered last, wherever it lies.
CUT_BOX := 35mm,-70mm,-20mm,75mm,-35mm,60mm
meshes-committed: $(MESH_GENERATOR) $(OUT)/bin/tm-mesh
	for s in block cylinder liver; do $(MESH_GENERATOR) $$s 1000 meshes/$${s}_1k && $(MESH_GENERATOR) $$s 10000 meshes/$${s}_10k || exit 1; done
	$(OUT)/bin/tm-mesh refine --box $(CUT_BOX) --size 8mm --fibres meshes/liver_10k.fibres.csv --write-fibres $(OUT)/refined.fibres.csv \
		meshes/liver_10k.msh -o $(OUT)/refined.msh
	$(OUT)/bin/tm-mesh renumber --fibres $(OUT)/refined.fibres.csv --write-fibres meshes/liver_cut.fibres.csv $(OUT)/refined.msh -o meshes/liver_cut.msh
