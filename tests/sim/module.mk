# test_unstable runs tm-sim in a program of its own, so that faults can be planted in its world; test_transitions replays what scenes
# sent through the controller's laws.
$(foreach t,$(sort $(wildcard tests/sim/test_*.c)),$(eval $(call test,$(t),$(LIBREPLAY_A) $(LIBAPP_A) $(SIM_LIBS),-lyaml -lcjson)))
FAIL_CALLOC := $(OUT)/tests/sim/fail_calloc.so
$(FAIL_CALLOC): tests/sim/fail_calloc.c
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) -shared -fPIC -O1 -Wall -fno-builtin -o $@ $<
tests: $(FAIL_CALLOC)
