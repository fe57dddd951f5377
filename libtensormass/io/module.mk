# libtensormass_io.so and .a: meshes and fibres from files; what it needs is the core.
TMIO_SRC := $(sort $(wildcard libtensormass/io/*.c))
LIBTMIO_A := $(OUT)/lib/libtensormass_io.a
LIBTMIO_SO := $(OUT)/lib/libtensormass_io.so.$(VERSION)
LIBRARIES += $(LIBTMIO_A) $(LIBTMIO_SO)
$(LIBTMIO_A): $(call objects,$(TMIO_SRC))
	$(archive)
# The core by its file: its own module.mk is read after this one.
$(LIBTMIO_SO): $(call objects,$(TMIO_SRC)) $(OUT)/lib/libtensormass.so.$(VERSION)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -shared -Wl,-soname,libtensormass_io.so.$(SOVERSION) $(if $(SAN),,-Wl,--no-undefined) $(ORIGIN) -o $@ $(call objects,$(TMIO_SRC)) -L$(OUT)/lib -ltensormass -lm
	$(Q)ln -sf $(@F) $(@D)/libtensormass_io.so.$(SOVERSION) && ln -sf libtensormass_io.so.$(SOVERSION) $(@D)/libtensormass_io.so
