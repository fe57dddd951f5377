# The controller's core, node, device and programs. Plain C tests; test_*.py run the programs.
$(foreach t,$(sort $(wildcard tests/loop/test_*.c)),$(eval $(call test,$(t),$(LIBHRT_DEVICE_A) $(LIBHRT_IO_A) $(LIBHRT_A) $(LIBLCMTYPES_A) $(LIBTM_A),)))
$(patsubst %.c,$(OUT)/obj/%.o,$(wildcard tests/loop/test_*.c)): CFLAGS_EXTRA += -Wno-float-conversion
# The codec alone, for Python (tests/can/test_dbc.py).
tests: $(OUT)/tests/can/codec.so
$(OUT)/tests/can/codec.so: haptic_rt/can/codec.c haptic_rt/can/codec.h
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) -shared -fPIC -O1 $(INCLUDES) -o $@ $(filter %.c,$^)
# A process's clocks as a test wants them (tests/loop/soak.py).
FAKE_CLOCK := $(OUT)/tests/loop/fake_clock.so
$(FAKE_CLOCK): tests/loop/fake_clock.c
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) -shared -fPIC -O1 -Wall -o $@ $< -ldl
tests: $(FAKE_CLOCK)
