# Cutting of whole organs from files: the generated ones and, when TM_EXTRA_MESHES names a folder, every mesh in it.
$(foreach t,$(sort $(wildcard tests/cut/test_*.c)),$(eval $(call test,$(t),$(LIBAPP_A) $(LIBTM_A),)))
