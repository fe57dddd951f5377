/* The emulated Cortex-M's port: SysTick at 25 MHz and, under `-icount shift=0`, one instruction per nanosecond: 40
 * instructions per count. */
#include "port.h"

#include "firmware/loop.h"
#include "firmware/systick.h"

enum { CORE_HZ = 25000000, INSTRUCTIONS_A_COUNT = 40 };

extern uint32_t fw_tick_stack_begin[], fw_tick_stack_end[], fw_main_stack_begin[], fw_main_stack_end[];
static volatile bool ticked;

void fw_systick(void) {
    port_tick();
    ticked = true;
}

void port_start(void) { systick_start(CORE_HZ, FW_PERIOD_US); }

/* An interrupt before main sleeps would have arrived during main's work: the work of a tick must not take that long. */
void port_wait_tick(void) {
    if (ticked) port_panic("a tick came before main had finished the last one's work");
    while (!ticked) __asm volatile("wfi");
    ticked = false;
}

uint32_t port_count(void) { return SYST_CVR; }

/* Reads SysTick, which counts down. Adds one count, as both ends are truncated: an upper bound. */
uint32_t port_since(uint32_t count) {
    const uint32_t now = SYST_CVR, period = SYST_RVR + 1u;
    return ((count + period - now) % period + 1u) * INSTRUCTIONS_A_COUNT;
}

static uint32_t high_water(const uint32_t *begin, const uint32_t *end) {
    const uint32_t *untouched = begin;
    while (untouched < end && *untouched == FW_STACK_PAINT) untouched++;
    return (uint32_t)((uintptr_t)end - (uintptr_t)untouched);
}

static void write_file(const char *path, const void *bytes, uint32_t size) {
    const int32_t file = semihost_open(path, true);
    if (file < 0 || !semihost_write(file, bytes, size)) semihost_exit(3);
    semihost_close(file);
}

_Noreturn void port_finish(void) {
    const uint32_t report[] = {high_water(fw_tick_stack_begin, fw_tick_stack_end),
                               high_water(fw_main_stack_begin, fw_main_stack_end), sizeof(fw_device),
                               sizeof(hrt_controller), sizeof(hrt_patch)};
    write_file("replay.report", report, sizeof report);
    semihost_exit(0);
}

_Noreturn void port_panic(const char *why) {
    uint32_t length = 0;
    while (why[length]) length++;
    write_file("replay.panic", why, length);
    semihost_exit(1);
}
