# The firmware in an emulator on recorded inputs, against the host: build/firmware/report.json.
FW_REPLAY_SRC := $(FW_SRC) $(addprefix tests/firmware/,board_replay.c replay_format.c port_m.c semihost.c)
$(foreach c,$(FW_CPUS),$(foreach v,$(FW_VARIANTS),$(eval $(call fw_image,$(c),$(v),replay,$(FW_REPLAY_SRC)))))
FW_REPLAY_ELF := $(foreach c,$(FW_CPUS),$(foreach v,$(FW_VARIANTS),$(BUILD)/firmware/$(c)/$(v)/replay.elf))

# The host's reference: the same loop, replay and core, left out of it what the images leave out; one with patches and one
# without. And the recorder.
FW_HOST_SRC := $(addprefix tests/firmware/,board_replay.c replay_format.c port_host.c) $(addprefix haptic_rt/firmware/,loop.c main.c) $(FW_CORE_SRC)
define fw_host
$(OUT)/tests/firmware/$(1): $(patsubst %.c,$(OUT)/tests/firmware/obj/$(1)/%.o,$(2)) $(LIBHRT_A) $(3)
	$$(call say,LINK)
	$$(Q)$$(CC) $$(SAN) -o $$@ $$^ -lm
$(OUT)/tests/firmware/obj/$(1)/%.o: %.c
	@mkdir -p $$(@D)
	$$(call say,CC)
	$$(Q)$$(CC) $$(BASE_CFLAGS) $$(INCLUDES) $(4) -c $$< -o $$@
-include $(patsubst %.c,$(OUT)/tests/firmware/obj/$(1)/%.d,$(2))
endef
$(eval $(call fw_host,replay_plain,$(FW_HOST_SRC),,-DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DFW_PATCHES=0))
$(eval $(call fw_host,replay_contact,$(FW_HOST_SRC),,-DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DFW_PATCHES=1))
$(eval $(call fw_host,record,tests/firmware/record.c tests/firmware/replay_format.c haptic_rt/firmware/loop.c,$(LIBHRT_DEVICE_A) $(LIBHRT_IO_A),-DFW_PATCHES=1))

#: make check-firmware       the firmware in QEMU on recorded inputs: the host's bits, flash, RAM, stack, instructions per tick
.PHONY: check-firmware firmware-replay
firmware-replay: $(FW_ELF) $(FW_REPLAY_ELF) $(addprefix $(OUT)/tests/firmware/,replay_plain replay_contact record)
check-firmware:
	@tools/setup.sh build check
	@$(MAKE) --no-print-directory venv firmware-replay
	TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python -m pytest tests/firmware -q -p no:cacheprovider $(PYTEST_ARGS)
	@$(VENV)/bin/python tests/firmware/report.py $(BUILD)/firmware/report.json
