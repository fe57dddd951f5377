# The controller on a Cortex-M7 and a Cortex-M4F: build/firmware/CPU/VARIANT/haptic_rt.elf. The same core sources as the host's.
# Variants: plain (no patches: `local_model` runs as `tangent`), contact12, contact24.
FW_CC := arm-none-eabi-gcc
FW_CPUS := m7 m4f
FW_VARIANTS := plain contact12 contact24
# Ticks a second: make firmware FW_RATE=4000 builds build/firmware-4000.
FW_RATE := 500
FW_OUT := $(BUILD)/firmware$(filter-out -500,-$(FW_RATE))
FW_CPU_m7 := -mcpu=cortex-m7 -mfpu=fpv5-sp-d16
FW_CPU_m4f := -mcpu=cortex-m4 -mfpu=fpv4-sp-d16
FW_DEF_plain := -DFW_PATCHES=0 -DHRT_WITH_PATCHES=0 -DHRT_WITH_FRICTION=0 -DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DHRT_PATCH_MAX_VERTICES=3 -DHRT_PATCH_MAX_TRIANGLES=1
FW_DEF_contact12 := -DFW_PATCHES=1 -DHRT_WITH_FRICTION=0 -DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0 -DHRT_PATCH_MAX_VERTICES=12 -DHRT_PATCH_MAX_TRIANGLES=16
FW_DEF_contact24 := -DFW_PATCHES=1 -DHRT_WITH_FRICTION=0 -DHRT_WITH_EVIDENCE=0 -DHRT_WITH_ADAPTIVE=0
# An enum has one byte here, so that a check against negative values is always true.
FW_WARN := -Wall -Wextra -Wno-type-limits -Wconversion -Wno-sign-conversion -Wdouble-promotion -Werror
# Optimisations by which -Os still trades flash for speed: constants kept in registers across loops, code moved apart for scheduling,
# unsplit expressions, copies of functions and jumps, reordered blocks, values saved around calls.
FW_SMALL := -fno-move-loop-invariants -fno-schedule-insns2 -fno-tree-ter -fno-caller-saves -fno-ipa-cp -fno-tree-dominator-opts -fno-reorder-blocks -fno-tree-vrp -fno-tree-slsr -fno-ssa-phiopt -fno-tree-tail-merge -fweb
# No contraction to fused multiply-adds: results must be bit-identical to the host's.
FW_CODE := -std=c11 -Os $(FW_SMALL) -g -mthumb -mfloat-abi=hard -ffp-contract=off -fno-math-errno -ffunction-sections -fdata-sections
# One device only: a second one would need more flash.
FW_DEVICE := -DHRT_WITH_WORDS=0 -DHRT_ONE_DEVICE -DFW_PERIOD_US=$(shell expr 1000000 / $(FW_RATE))
FW_CFLAGS := $(FW_CODE) $(FW_DEVICE) -MMD -MP $(FW_WARN) -I. -Ihaptic_rt -Ihaptic_rt/core
# Link-time optimisation of the core only: saves 0.5 to 0.8 kB. Not of the other code, so that the map attributes sizes.
fw_whole = $(if $(filter haptic_rt/core/%,$(1)),-flto)
FW_LDFLAGS := $(FW_CODE) -flto -nostartfiles -specs=nano.specs -Wl,--gc-sections -T haptic_rt/firmware/link.ld
FW_CORE_SRC := $(HRT_CORE_SRC)
FW_SRC := $(addprefix haptic_rt/firmware/,start.c loop.c main.c)
# $(call firmware,NAME,OTHER SOURCES): build/firmware/CPU/VARIANT/NAME.elf and its map, of every processor and variant; firmware_elf: these files.
firmware = $(foreach c,$(FW_CPUS),$(foreach v,$(FW_VARIANTS),$(eval $(call firmware_rule,$(FW_OUT)/$(c)/$(v),$(1),$(2),$(FW_CPU_$(c)),$(FW_DEF_$(v))))))
firmware_elf = $(foreach c,$(FW_CPUS),$(foreach v,$(FW_VARIANTS),$(FW_OUT)/$(c)/$(v)/$(1).elf))
define firmware_rule
$(1)/$(2).elf: $(patsubst %.c,$(1)/obj/%.o,$(3) $(FW_CORE_SRC)) haptic_rt/firmware/link.ld
	$$(call step,LINK)
	$$(Q)$$(FW_CC) $(4) $$(FW_LDFLAGS) -Wl,-Map=$$(@:.elf=.map) -o $$@ $$(filter %.o,$$^) -lm
$(1)/obj/%.o: %.c haptic_rt/firmware/module.mk
	$$(call step,CC)
	$$(Q)$$(FW_CC) $(4) $$(FW_CFLAGS) $(5) $$(call fw_whole,$$<) -c $$< -o $$@
endef
$(call firmware,haptic_rt,$(FW_SRC) haptic_rt/firmware/board_mps2.c)

#: make firmware             the controller for Cortex-M7 and M4F: build/firmware/CPU/VARIANT/haptic_rt.elf and their sizes (FW_RATE=4000: of so many ticks a second)
firmware:
	$(call ready,build check,firmware-elf)
firmware-elf: $(call firmware_elf,haptic_rt)
	@arm-none-eabi-size $^
