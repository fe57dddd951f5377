# Runs the firmware in an emulator on recorded inputs and compares it with the host: build/firmware/report.json.
$(call firmware,replay,$(FW_SRC) $(patsubst %,tests/firmware/%.c,board_replay replay_format port_m semihost))

# The host's reference: the same loop, replay and core, without the features that the images omit; one with patches and one
# without. Also the recorder. $(call firmware_host,NAME,SOURCES,OUR LIBRARIES,FLAGS)
firmware_host = $(eval $(call firmware_host_rule,$(OUT)/tests/firmware,$(1),$(2),$(call lib,hrt $(3)),$(4)))
define firmware_host_rule
$(1)/$(2): $(patsubst %.c,$(1)/obj/$(2)/%.o,$(3)) $(4)
	$$(call step,LINK)
	$$(Q)$$(CC) $$(SAN) -o $$@ $$^ -lm
$(1)/obj/$(2)/%.o: %.c
	$$(call step,CC)
	$$(Q)$$(CC) $$(BASE_CFLAGS) $$(INCLUDES) $(5) -c $$< -o $$@
firmware-replay: $(1)/$(2)
endef
FW_HOST_SRC := $(patsubst %,tests/firmware/%.c,board_replay replay_format port_host) haptic_rt/firmware/loop.c haptic_rt/firmware/main.c $(FW_CORE_SRC)
$(call firmware_host,replay_plain,$(FW_HOST_SRC),,-DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DFW_PATCHES=0)
$(call firmware_host,replay_contact,$(FW_HOST_SRC),,-DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DFW_PATCHES=1)
$(call firmware_host,record,tests/firmware/record.c tests/firmware/replay_format.c haptic_rt/firmware/loop.c,$(DEVICE_LIBS),-DFW_PATCHES=1)

#: make check-firmware       the firmware in QEMU on recorded inputs: the host's bits, flash, RAM, stack, instructions per tick
firmware-replay: $(call firmware_elf,haptic_rt) $(call firmware_elf,replay)
check-firmware:
	$(call ready,build check,venv firmware-replay)
	$(call pytest_of,firmware)
	@$(VENV)/bin/python tests/firmware/report.py $(BUILD)/firmware/report.json
