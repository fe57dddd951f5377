# libhrt.a: core + CAN codec, no operating system. libhrt_io.a: node, mailbox, bus drivers, virtual device; no LCM; tm-sim's lockstep links both.
HRT_CORE_SRC := $(sort $(wildcard haptic_rt/core/*.c) $(wildcard haptic_rt/can/*.c))
HRT_IO_SRC := $(sort $(wildcard haptic_rt/io/bus*.c) haptic_rt/io/node.c haptic_rt/device/device.c)
LIBHRT_A := $(OUT)/lib/libhrt.a
LIBHRT_IO_A := $(OUT)/lib/libhrt_io.a
LIBRARIES += $(LIBHRT_A) $(LIBHRT_IO_A)
$(LIBHRT_A): $(call objects,$(HRT_CORE_SRC))
	@mkdir -p $(@D)
	rm -f $@ && ar rcs $@ $^
$(LIBHRT_IO_A): $(call objects,$(HRT_IO_SRC))
	@mkdir -p $(@D)
	rm -f $@ && ar rcs $@ $^
# The core is compiled more strictly than the rest.
$(call objects,$(HRT_CORE_SRC)): CFLAGS_EXTRA += -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Werror
$(OUT)/obj/haptic_rt/can/impulse_engine.o: CFLAGS_EXTRA += -Wno-error -Wno-conversion -Wno-sign-conversion -Wno-missing-prototypes
