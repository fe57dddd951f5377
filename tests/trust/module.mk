# What a peer on the network may do: the receiver, the seal, and attacks on running programs (test_trust.py).
$(foreach t,$(sort $(wildcard tests/trust/test_*.c)),$(eval $(call test,$(t),$(LIBLCMTYPES_A) $(LIBAPP_A) $(LIBTM_A),-llcm)))
