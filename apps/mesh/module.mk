# tm-mesh looks at meshes, mends, fills and refines them.
$(eval $(call program,tm-mesh,$(sort $(wildcard apps/mesh/*.c)),$(LIBTMSCENE_A) $(LIBAPP_A) $(LIBTM_A),-lcjson))
