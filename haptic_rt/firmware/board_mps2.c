/* Arm MPS2 boards (AN386: Cortex-M4F, AN500: Cortex-M7), 25 MHz. They have no CAN controller: the driver is a loop-back
 * queue, to be replaced by a real part's registers. The watchdog is the CMSDK's. */
#include "loop.h"
#include "systick.h"

enum { CORE_HZ = 25000000 };
#define WATCHDOG_LOAD (*(volatile uint32_t *)0x40008000u)
#define WATCHDOG_CONTROL (*(volatile uint32_t *)0x40008008u)
enum { WATCHDOG_COUNT_AND_RESET = 3, WATCHDOG_US = 20000, QUEUE = 16 };

static void (*tick_handler)(void);
static int64_t now_us; /* used by the tick only */
static struct {
    hrt_can_frame frame[QUEUE];
    uint32_t head, tail;
} queue;

void fw_systick(void) {
    now_us += FW_PERIOD_US;
    tick_handler();
}

void fw_board_start(void (*tick)(void)) {
    tick_handler = tick;
    fw_board_watchdog();
    WATCHDOG_CONTROL = WATCHDOG_COUNT_AND_RESET;
    systick_start(CORE_HZ, FW_PERIOD_US);
}

void fw_board_sleep(void) { __asm volatile("wfi" ::: "memory"); }
int64_t fw_board_now_us(void) { return now_us; }
void fw_board_watchdog(void) { WATCHDOG_LOAD = (uint32_t)CORE_HZ / 1000000u * WATCHDOG_US; }

_Noreturn void fw_board_panic(const char *why) {
    (void)why;
    for (;;) {
    } /* no further command; the watchdog resets the board */
}

bool fw_can_receive(hrt_can_frame *frame) {
    if (queue.head == queue.tail) return false;
    *frame = queue.frame[queue.tail++ % QUEUE];
    return true;
}

bool fw_can_send(const hrt_can_frame *frame) {
    if (queue.head - queue.tail == QUEUE) return false;
    queue.frame[queue.head++ % QUEUE] = *frame;
    return true;
}

bool fw_can_ok(void) { return true; }

void fw_link_receive(int32_t device, fw_news *news, hrt_sample *sample, hrt_patch *patch) {
    (void)device;
    (void)news;
    (void)sample;
    (void)patch;
}

void fw_link_send(int32_t device, const hrt_result *result) {
    (void)device;
    (void)result;
}

void fw_measure_begin(int32_t device, fw_span span) {
    (void)device;
    (void)span;
}
void fw_measure_end(int32_t device, fw_span span) {
    (void)device;
    (void)span;
}
