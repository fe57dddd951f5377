/* The emulated Cortex-M: SysTick at 25 MHz and, under `-icount shift=0`, one instruction a nanosecond: 40 instructions a count. */
#include "port.h"

#include "firmware/board.h"
#include "firmware/systick.h"

enum { CORE_HZ = 25000000, INSTRUCTIONS_A_COUNT = 40 };

extern uint32_t fw_stack_begin[], fw_stack_end[];
static volatile uint32_t interrupts;
static uint32_t taken;

void fw_systick(void) { interrupts++; }

void port_start(void) { systick_start(CORE_HZ, FW_PERIOD_US); }

uint32_t port_wait_tick(void) {
    while (interrupts == taken) __asm volatile("wfi");
    const uint32_t now = interrupts, since = now - taken;
    taken = now;
    return since;
}

uint32_t port_count(void) { return SYST_CVR; }

/* SysTick counts down. One count more, since both ends are cut: an upper bound. */
uint32_t port_since(uint32_t count) {
    const uint32_t now = SYST_CVR, period = SYST_RVR + 1u;
    return ((count + period - now) % period + 1u) * INSTRUCTIONS_A_COUNT;
}

static uint32_t stack_high_water(void) {
    const uint32_t *untouched = fw_stack_begin;
    while (untouched < fw_stack_end && *untouched == FW_STACK_PAINT) untouched++;
    return (uint32_t)((uintptr_t)fw_stack_end - (uintptr_t)untouched);
}

static void write_text(const char *path, const char *text, uint32_t size) {
    const int32_t file = semihost_open(path, true);
    if (file < 0 || !semihost_write(file, text, size)) semihost_exit(3);
    semihost_close(file);
}

_Noreturn void port_finish(void) {
    const uint32_t report[2] = {stack_high_water(), (uint32_t)((uintptr_t)fw_stack_end - (uintptr_t)fw_stack_begin)};
    write_text("replay.stack", (const char *)report, sizeof report);
    semihost_exit(0);
}

_Noreturn void port_panic(const char *why) {
    uint32_t length = 0;
    while (why[length]) length++;
    write_text("replay.panic", why, length);
    semihost_exit(1);
}
