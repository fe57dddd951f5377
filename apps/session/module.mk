# tm-session: a scene's programs by one command, from a prefix as from here. Python with its own library alone.
SESSION_PARTS := $(addprefix $(OUT)/lib/tensormass/session/,session.py netns.sh display.py)
SESSION_PROGRAM := $(OUT)/bin/tm-session
SCRIPTS += $(SESSION_PROGRAM) $(SESSION_PARTS)
$(SESSION_PARTS): $(OUT)/lib/tensormass/session/%: apps/demo/%
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)cp -p $< $@
$(SESSION_PROGRAM): apps/session/tm_session.py Makefile | $(SESSION_PARTS)
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)sed 's/@VERSION@/$(VERSION)/' $< > $@ && chmod 755 $@
