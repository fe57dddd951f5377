# tm-mesh looks at meshes, mends, fills and refines them.
$(eval $(call program,tm-mesh,$(sort $(wildcard apps/mesh/*.c)),$(LIBAPP_A) $(LIBTM_A),-lcjson))
