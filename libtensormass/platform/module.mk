# libplatform.a: what every program needs: errors, signals, output files, log lines, modules.
PLATFORM_SRC := $(sort $(wildcard libtensormass/platform/*.c))
LIBPLATFORM_A := $(OUT)/lib/libplatform.a
LIBRARIES += $(LIBPLATFORM_A)
$(LIBPLATFORM_A): $(call objects,$(PLATFORM_SRC))
	$(archive)
