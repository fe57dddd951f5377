# The precomputed and the hybrid model.
$(foreach t,$(sort $(wildcard tests/solve/test_*.c)),$(eval $(call test,$(t),$(LIBTMS_A) $(LIBTM_A),$(TMS_LIBS))))
