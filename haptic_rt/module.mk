# libhrt: core and CAN codec, without operating system; libhrt_core: the core alone. libhrt_io: node, mailbox, controller's side of the messages, bus drivers.
# libhrt_motion: joints to tip in double, scripted hands. libhrt_device: the virtual device.
HRT_CORE_SRC := $(call files,haptic_rt/core/*.c haptic_rt/can/*.c)
$(call library,hrt,$(HRT_CORE_SRC))
$(call library,hrt_core,$(call files,haptic_rt/core/*.c))
$(call library,hrt_io,$(call files,haptic_rt/io/bus*.c) $(addprefix haptic_rt/io/,from_message.c histogram.c line_reader.c network.c node.c peer.c profile.c csv_table.c identify.c drive.c workspace.c))
$(call library,hrt_motion,$(call files,haptic_rt/motion/*.c))
$(call library,hrt_device,haptic_rt/device/device.c haptic_rt/device/handle.c)
# The core has stricter compiler options than other code.
$(call objects,$(HRT_CORE_SRC)): CFLAGS_EXTRA += -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Werror

HRT_PROGRAM_SRC := $(addprefix haptic_rt/io/,command.c network_peer.c loop.c report.c)
# Devices with a service or library of their own. Haply's driver needs libwebsockets; if that is missing it is omitted and its error says so. A file records
# the choice, so that installing the library triggers a rebuild.
HRT_DRIVE_SRC := $(call files,haptic_rt/io/drive_*.c)
HRT_WEBSOCKETS = $(shell pkg-config --exists libwebsockets && echo 1)
$(OUT)/gen/websockets.txt: FORCE
	@mkdir -p $(@D); echo '$(HRT_WEBSOCKETS)' | cmp -s - $@ || { echo '$(HRT_WEBSOCKETS)' > $@; $(if $(HRT_WEBSOCKETS),:,echo '  haptic-rt: the driver for Haply is left out, since libwebsockets-dev is missing'); }
.PHONY: FORCE
$(call objects,haptic_rt/io/drive_haply.c): $(OUT)/gen/websockets.txt
$(call objects,haptic_rt/io/drive_haply.c): CFLAGS_EXTRA += $(if $(HRT_WEBSOCKETS),-DHRT_WITH_HAPLY $(call pkg_cflags,libwebsockets))
$(call program,haptic-rt,$(addprefix haptic_rt/io/,haptic_rt.c record.c samples.c setup.c status_log.c settings.c) $(HRT_PROGRAM_SRC) $(HRT_DRIVE_SRC),hrt_io hrt platform tensormass lcm_types,-lcjson $$(if $$(HRT_WEBSOCKETS),-lwebsockets))
$(call program,tm-device,haptic_rt/device/tm_device.c haptic_rt/device/hand_file.c $(HRT_PROGRAM_SRC),$(DEVICE_LIBS) platform tensormass lcm_types,-lcjson)

#: make lint-core              clang-tidy (cert, bugprone) and cppcheck over the controller's core and codec
LINT_INCLUDES := -I. -Ihaptic_rt -Ihaptic_rt/core
lint-core:
	clang-tidy --quiet $(HRT_CORE_SRC) -- -std=c11 $(LINT_INCLUDES)
	cppcheck --quiet --enable=warning,style,performance,portability --inline-suppr --suppress=unusedStructMember --std=c11 --error-exitcode=1 $(LINT_INCLUDES) $(HRT_CORE_SRC)
