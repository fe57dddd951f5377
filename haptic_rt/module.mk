# libhrt.a: core + CAN codec, no operating system. libhrt_io.a: node, mailbox, its side of the messages, bus drivers. libhrt_motion.a: joints to tip in double, scripted hands. libhrt_device.a: the virtual device. tm-sim's lockstep links all four.
HRT_CORE_SRC := $(sort $(wildcard haptic_rt/core/*.c) $(wildcard haptic_rt/can/*.c))
HRT_IO_SRC := $(sort $(wildcard haptic_rt/io/bus*.c) $(addprefix haptic_rt/io/,from_message.c histogram.c lines.c network.c node.c peer.c profile.c table.c))
HRT_DEVICE_SRC := haptic_rt/device/device.c
HRT_MOTION_SRC := $(sort $(wildcard haptic_rt/motion/*.c))
LIBHRT_A := $(OUT)/lib/libhrt.a
LIBHRT_IO_A := $(OUT)/lib/libhrt_io.a
LIBHRT_MOTION_A := $(OUT)/lib/libhrt_motion.a
LIBHRT_DEVICE_OWN_A := $(OUT)/lib/libhrt_device.a
LIBHRT_DEVICE_A := $(LIBHRT_DEVICE_OWN_A) $(LIBHRT_MOTION_A)
LIBRARIES += $(LIBHRT_A) $(LIBHRT_IO_A) $(LIBHRT_DEVICE_A)
# The core alone, for programs that know devices and no bus.
LIBHRT_CORE_A := $(OUT)/lib/libhrt_core.a
LIBRARIES += $(LIBHRT_CORE_A)
$(LIBHRT_CORE_A): $(call objects,$(filter haptic_rt/core/%,$(HRT_CORE_SRC)))
	$(archive)
$(LIBHRT_A): $(call objects,$(HRT_CORE_SRC))
	$(archive)
$(LIBHRT_IO_A): $(call objects,$(HRT_IO_SRC))
	$(archive)
$(LIBHRT_DEVICE_OWN_A): $(call objects,$(HRT_DEVICE_SRC))
	$(archive)
$(LIBHRT_MOTION_A): $(call objects,$(HRT_MOTION_SRC))
	$(archive)
# The core is compiled more strictly than the rest.
$(call objects,$(HRT_CORE_SRC)): CFLAGS_EXTRA += -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Werror

# By path: these libraries are named by module.mk files that are read later.
HRT_LIBS := $(LIBHRT_IO_A) $(LIBHRT_A) $(OUT)/lib/libplatform.a $(OUT)/lib/libtensormass.a $(OUT)/lib/liblcm_types.a
HRT_PROGRAMS := $(OUT)/bin/haptic-rt $(OUT)/bin/tm-device
HRT_PROGRAM_SRC := $(addprefix haptic_rt/io/,command.c live.c loop.c report.c)
$(eval $(call program,haptic-rt,haptic_rt/io/haptic_rt.c haptic_rt/io/record.c haptic_rt/io/samples.c haptic_rt/io/say.c haptic_rt/io/settings.c $(HRT_PROGRAM_SRC),$(HRT_LIBS),-lcjson))
$(eval $(call program,tm-device,haptic_rt/device/tm_device.c haptic_rt/device/hand_file.c $(HRT_PROGRAM_SRC),$(LIBHRT_DEVICE_A) $(HRT_LIBS),-lcjson))
#: make lint-core              clang-tidy (cert, bugprone) and cppcheck over the controller's core and codec
.PHONY: lint-core
lint-core:
	clang-tidy --quiet $(HRT_CORE_SRC) -- -std=c11 -I. -Ihaptic_rt -Ihaptic_rt/core
	cppcheck --quiet --enable=warning,style,performance,portability --inline-suppr --suppress=unusedStructMember --std=c11 --error-exitcode=1 \
		-I. -Ihaptic_rt -Ihaptic_rt/core $(HRT_CORE_SRC)
