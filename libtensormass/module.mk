# libtensormass.so and .a: the core, with no dependency but libc and libm.
TM_SRC := $(sort $(wildcard libtensormass/src/*/*.c))
LIBTM_A := $(OUT)/lib/libtensormass.a
LIBTM_SO := $(OUT)/lib/libtensormass.so.$(VERSION)
LIBRARIES += $(LIBTM_A) $(LIBTM_SO)
$(LIBTM_A): $(call objects,$(TM_SRC))
	$(archive)
$(LIBTM_SO): $(call objects,$(TM_SRC))
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -shared -Wl,-soname,libtensormass.so.$(SOVERSION) $(if $(SAN),,-Wl,--no-undefined) -o $@ $^ -lm
	$(Q)ln -sf $(@F) $(@D)/libtensormass.so.$(SOVERSION) && ln -sf libtensormass.so.$(SOVERSION) $(@D)/libtensormass.so
