# tm-organ: from an image, a surface or a mesh to an organ that is felt, by one command. Python with its own library alone.
ORGAN_PROGRAM := $(OUT)/bin/tm-organ
SCRIPTS += $(ORGAN_PROGRAM)
$(ORGAN_PROGRAM): apps/organ/tm_organ.py Makefile
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)sed 's/@VERSION@/$(VERSION)/' $< > $@ && chmod 755 $@

#: make organ IMAGE= ORGAN_ARGS=  from a segmented image, a surface or a mesh to an organ that is felt: build/organ/
.PHONY: organ organ-run
organ:
	@$(if $(IMAGE),,echo "make organ: no IMAGE; make organ IMAGE=seg.nii.gz (or .stl, .msh; tm-organ --help)" >&2; exit 2)
	@tools/setup.sh build
	@$(MAKE) --no-print-directory -j$$(nproc) programs
	@$(MAKE) --no-print-directory organ-run
organ-run:
	@$(OUT)/bin/tm-organ '$(IMAGE)' -o $(OUT)/organ $(ORGAN_ARGS)
