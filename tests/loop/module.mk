# The controller's core, node, device and programs. Plain C tests; test_*.py run the programs.
$(foreach t,$(sort $(wildcard tests/loop/test_*.c)),$(eval $(call test,$(t),$(LIBHRT_IO_A) $(LIBHRT_A),)))
$(patsubst %.c,$(OUT)/obj/%.o,$(wildcard tests/loop/test_*.c)): CFLAGS_EXTRA += -Wno-float-conversion
