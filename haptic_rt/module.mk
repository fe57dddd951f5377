# libhrt.a: core + CAN codec (no operating system). libhrt_io.a: node, mailbox, bus drivers, virtual device (no LCM), for tm-sim's lockstep too.
HRT_CORE_SRC := $(sort $(wildcard haptic_rt/core/*.c) $(wildcard haptic_rt/can/*.c))
HRT_IO_SRC := $(sort $(wildcard haptic_rt/io/*.c) $(filter-out haptic_rt/device/main.c,$(wildcard haptic_rt/device/*.c)))
LIBHRT_A := $(OUT)/lib/libhrt.a
LIBHRT_IO_A := $(OUT)/lib/libhrt_io.a
