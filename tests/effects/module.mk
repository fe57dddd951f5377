# The first wish, as far as the library goes: a step costs what it was asked for and nothing else.
PLAIN_STEP := $(OUT)/tests/effects/plain_step
$(PLAIN_STEP): $(call objects,tests/effects/plain_step.c) $(LIBTM_A)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -o $@ $(call objects,tests/effects/plain_step.c) $(LIBTM_A) -lcmocka -lm
tests: $(PLAIN_STEP)
