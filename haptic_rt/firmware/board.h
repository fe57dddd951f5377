/* What the firmware asks of a board: a periodic tick, a CAN controller, a link to the simulation, a watchdog. One
 * board_*.c implements it. The tick runs in the timer's interrupt; what may take longer than a tick (checking a patch)
 * runs below it, in main. */
#ifndef FW_BOARD_H
#define FW_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "can/frame.h"
#include "hrt.h"

#ifndef FW_DEVICES
#define FW_DEVICES 2
#endif
enum { FW_PERIOD_US = 2000 };
#define FW_STACK_PAINT 0xA5A5A5A5u

/* CAN at 1 Mbit/s, the link, the watchdog, and a timer interrupt every FW_PERIOD_US that calls `tick`. */
void fw_board_start(void (*tick)(void));
/* In main, below the tick: sleeps until there was an interrupt. */
void fw_board_sleep(void);
/* In the tick. This clock need not agree with anybody's: the timer's interrupts counted are enough. */
int64_t fw_board_now_us(void);
/* From the tick. When it does not come for a few ticks the board resets; the device's own watchdog has dropped the
 * torque by then. */
void fw_board_watchdog(void);
/* Something that cannot be: no command leaves the board any more. */
_Noreturn void fw_board_panic(const char *why);

/* The CAN controller, from the tick: classical frames, in the order of the bus. False: none waits, or no room. */
bool fw_can_receive(hrt_can_frame *frame);
bool fw_can_send(const hrt_can_frame *frame);
/* False after bus-off; the driver recovers by itself (128 times 11 recessive bits). */
bool fw_can_ok(void);

/* What the link brought since the last tick: the newest whole message of each kind, positions already relative to the
 * trocar. */
typedef struct fw_news {
    bool sample, patch, command;
    bool enable, reset, passivity, coupling; /* with `command` */
    hrt_extrapolator extrapolator;
} fw_news;
/* In main. Writes at most one sample and, when it came with one, the patch into `patch` (null: this firmware has no
 * room for patches). */
void fw_link_receive(int32_t device, fw_news *news, hrt_sample *sample, hrt_patch *patch);
/* In the tick, for whoever listens: the tool's state for the simulation, the controller's status. */
void fw_link_send(int32_t device, const hrt_result *result);

/* The board's interrupt handler of the core's own timer (the vector table names it). */
void fw_systick(void);

#endif
