$(foreach t,$(sort $(wildcard tests/sim/test_*.c)),$(eval $(call test,$(t),$(LIBAPP_A) $(LIBTM_A),-lcjson)))
