/* Start-up of a Cortex-M with FPU: vectors, RAM, FPU, painted stack. Everything before main(). */
#include <stdint.h>

#include "board.h"

#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88u)
#define FPU_FULL_ACCESS (0xFu << 20)
#define IRQ_COUNT 32

extern uint32_t fw_data_begin[], fw_data_end[], fw_data_load[], fw_bss_begin[], fw_bss_end[], fw_stack_begin[], fw_stack_end[];
int main(void);
_Noreturn void fw_reset(void);
void fw_unexpected(void);

/* No handler of ours uses them: whatever arrives here is a fault, and a fault stops the commands, so that the device's own
 * watchdog drops the torque. */
void fw_unexpected(void) { fw_board_panic("unexpected exception"); }

__attribute__((noinline)) static void prepare_ram(void) {
    for (uint32_t *to = fw_data_begin, *from = fw_data_load; to < fw_data_end;) *to++ = *from++;
    for (uint32_t *to = fw_bss_begin; to < fw_bss_end;) *to++ = 0;
    /* Up to here, a little below the stack pointer of this very function. */
    uint32_t *top = (uint32_t *)__builtin_frame_address(0) - 16;
    for (uint32_t *to = fw_stack_begin; to < top;) *to++ = FW_STACK_PAINT;
}

_Noreturn void fw_reset(void) {
    SCB_CPACR |= FPU_FULL_ACCESS;
    __asm volatile("dsb\n isb" ::: "memory");
    prepare_ram();
    main();
    fw_board_panic("main returned");
}

typedef void (*vector)(void);
__attribute__((section(".vectors"), used)) static const vector vectors[16 + IRQ_COUNT] = {
    (vector)(uintptr_t)fw_stack_end,
    (vector)fw_reset,
    [2 ... 14] = fw_unexpected,
    fw_systick,
    [16 ... 16 + IRQ_COUNT - 1] = fw_unexpected,
};
