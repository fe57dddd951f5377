/* Start-up of a Cortex-M with FPU, before main(): vectors, RAM, FPU, two painted stacks. */
#include <stdint.h>

#include "board.h"

#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88u)
#define FPU_FULL_ACCESS (0xFu << 20)
#define IRQ_COUNT 32

extern uint32_t fw_data_begin[], fw_data_end[], fw_data_load[], fw_bss_begin[], fw_bss_end[];
extern uint32_t fw_tick_stack_begin[], fw_tick_stack_end[], fw_main_stack_begin[], fw_main_stack_end[];
int main(void);
_Noreturn void fw_reset(void);
_Noreturn void fw_start(void);
void fw_unexpected(void);

/* Handles unused vectors: any such exception is a fault. It stops the commands, so the device's own watchdog drops the
 * torque. */
void fw_unexpected(void) { fw_board_panic("unexpected exception"); }

/* Runs on main's stack, so that both stacks can be painted completely but for this frame. */
_Noreturn void fw_start(void) {
    for (uint32_t *to = fw_data_begin, *from = fw_data_load; to < fw_data_end;) *to++ = *from++;
    for (uint32_t *to = fw_bss_begin; to < fw_bss_end;) *to++ = 0;
    for (uint32_t *to = fw_tick_stack_begin; to < fw_tick_stack_end;) *to++ = FW_STACK_PAINT;
    uint32_t *top = (uint32_t *)__builtin_frame_address(0) - 16;
    for (uint32_t *to = fw_main_stack_begin; to < top;) *to++ = FW_STACK_PAINT;
    SCB_CPACR |= FPU_FULL_ACCESS;
    __asm volatile("dsb\n isb" ::: "memory");
    main();
    fw_board_panic("main returned");
}

/* Gives main its own stack; interrupts keep that of the vector table. */
__attribute__((naked)) _Noreturn void fw_reset(void) {
    __asm volatile("ldr r0, =fw_main_stack_end\n"
                   "msr psp, r0\n"
                   "movs r0, #2\n"
                   "msr control, r0\n"
                   "isb\n"
                   "b fw_start\n");
}

typedef void (*vector)(void);
__attribute__((section(".vectors"), used)) static const vector vectors[16 + IRQ_COUNT] = {
    (vector)(uintptr_t)fw_tick_stack_end,        (vector)fw_reset, [2 ... 14] = fw_unexpected, fw_systick,
    [16 ... 16 + IRQ_COUNT - 1] = fw_unexpected,
};
