$(eval $(call test,tests/view/test_skin.c,$(call objects,apps/view/skin.c apps/view/picture.c),))
$(eval $(call test,tests/view/test_wire.c,$(LIBAPP_A),))
