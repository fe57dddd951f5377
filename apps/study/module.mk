# tm-study: many runs of tm-sim in one table. Python with its own library alone.
STUDY_PROGRAM := $(OUT)/bin/tm-study
SCRIPTS += $(STUDY_PROGRAM)
$(STUDY_PROGRAM): apps/study/tm_study.py Makefile
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)sed 's/@VERSION@/$(VERSION)/' $< > $@ && chmod 755 $@
