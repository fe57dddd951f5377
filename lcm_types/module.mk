# C and Python bindings of the message types, and the jar with which lcm-spy decodes.
LCM_TYPES := $(sort $(wildcard lcm_types/*.lcm))
LCM_GEN := $(patsubst lcm_types/%.lcm,$(OUT)/gen/lcm_types/tensormass_%.c,$(LCM_TYPES))
# Generated code of every type, with the description by which message.c decodes; without functions that call liblcm.
LCM_ALL_H := $(OUT)/gen/lcm_types/tensormass.h
LIBRARIES += $(OUT)/python/tensormass_lcm/__init__.py
$(OUT)/gen/lcm_types/tensormass_%.c: lcm_types/%.lcm lcm_types/module.mk
	$(call step,LCM)
	$(Q)lcm-gen -c --c-typeinfo --c-no-pubsub --c-cpath $(@D) --c-hpath $(@D) --cinclude lcm_types $<
# The header is made with its .c: sources that include it are rebuilt when its type changes.
$(OUT)/gen/lcm_types/tensormass_%.h: $(OUT)/gen/lcm_types/tensormass_%.c ;
$(LCM_ALL_H): $(LCM_TYPES) lcm_types/module.mk | $(LCM_GEN)
	@printf '#include "lcm_types/tensormass_%s.h"\n' $(LCM_TYPES:lcm_types/%.lcm=%) > $@
# At the first build the including sources are not known yet.
$(call objects,$(wildcard lcm_types/*.c apps/*/*.c apps/*/*/*.c haptic_rt/*/*.c python/*/*.c tests/*/*.c)): | $(LCM_GEN) $(LCM_ALL_H)
# In addition to the generated code: the table of messages and links, reception, and authentication. Only the module links LCM.
$(call library,lcm_types,$(LCM_GEN:$(OUT)/gen/%=%) $(filter-out %/link_network.c,$(call files,lcm_types/*.c)))
$(call module,lcm,lcm_types/link_network.c,lcm_types,-llcm)
# Named tensormass_lcm: `tensormass` is the Python package, and a program may need both.
$(OUT)/python/tensormass_lcm/__init__.py: $(LCM_TYPES)
	$(call step,LCM)
	@rm -rf $(OUT)/python && mkdir -p $(OUT)/python/made
	$(Q)lcm-gen -p --ppath $(OUT)/python/made $(LCM_TYPES)
	@mv $(OUT)/python/made/tensormass $(@D) && rmdir $(OUT)/python/made && touch $@
$(OUT)/java/tensormass_types.jar: $(LCM_TYPES)
	$(call step,LCM)
	@rm -rf $(OUT)/java && mkdir -p $(OUT)/java/src $(OUT)/java/classes
	$(Q)lcm-gen -j --jpath $(OUT)/java/src $(LCM_TYPES)
	$(Q)javac -nowarn -cp /usr/share/java/lcm.jar -d $(OUT)/java/classes $$(find $(OUT)/java/src -name '*.java')
	$(Q)jar cf $@ -C $(OUT)/java/classes .
