# libapp.a: what the programs share beyond what the controller needs too. Quotes no heavy library: those sit in modules (app_module).
APP_SRC := $(sort $(wildcard apps/common/*.c))
LIBAPP_OWN_A := $(OUT)/lib/libapp.a
LIBAPP_A := $(LIBAPP_OWN_A) $(LIBPLATFORM_A) $(LIBTMIO_A)
LIBRARIES += $(LIBAPP_OWN_A)
$(LIBAPP_OWN_A): $(call objects,$(APP_SRC))
	$(archive)
