# What every program shares: output files, signals, options.
$(foreach t,$(sort $(wildcard tests/apps/test_*.c)),$(eval $(call test,$(t),$(OUT)/obj/haptic_rt/io/loop.o $(LIBHRT_DEVICE_A) $(LIBHRT_IO_A) $(LIBHRT_A) $(LIBAPP_A) $(LIBTM_A),-lcjson)))
