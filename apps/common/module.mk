# libapp.a: what every program shares. Quotes no heavy library: those sit in modules (app_module).
APP_SRC := $(sort $(wildcard apps/common/*.c))
LIBAPP_A := $(OUT)/lib/libapp.a
LIBRARIES += $(LIBAPP_A)
$(LIBAPP_A): $(call objects,$(APP_SRC))
	@mkdir -p $(@D)
	rm -f $@ && ar rcs $@ $^
# What of it needs no YAML: the controller's programs.
LIBAPP_PLAIN_A := $(OUT)/lib/libapp_plain.a
LIBRARIES += $(LIBAPP_PLAIN_A)
$(LIBAPP_PLAIN_A): $(call objects,$(filter-out apps/common/scene_%,$(APP_SRC)))
	@mkdir -p $(@D)
	rm -f $@ && ar rcs $@ $^
