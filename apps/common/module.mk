# libapp.a: what every program shares. Quotes no heavy library: those sit in modules (app_module).
APP_SRC := $(sort $(wildcard apps/common/*.c))
LIBAPP_A := $(OUT)/lib/libapp.a
LIBRARIES += $(LIBAPP_A)
$(LIBAPP_A): $(call objects,$(APP_SRC))
	@mkdir -p $(@D)
	rm -f $@ && ar rcs $@ $^
