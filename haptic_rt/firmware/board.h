/* Board interface of the firmware: a periodic tick, a CAN controller, a link to the simulation, a watchdog. One
 * board_*.c implements it. The tick runs in the timer's interrupt; longer work (checking a patch) runs below it, in
 * main. */
#ifndef FW_BOARD_H
#define FW_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "can/frame.h"
#include "hrt.h"

#ifndef FW_DEVICES
#define FW_DEVICES 2
#endif
#ifndef FW_PERIOD_US
#define FW_PERIOD_US 2000 /* 1,000,000 over a whole number of Hz, 250 to 10,000 */
#endif
#define FW_STACK_PAINT 0xA5A5A5A5u

/* Starts CAN at 1 Mbit/s, the link, the watchdog, and a timer interrupt every FW_PERIOD_US that calls `tick`. */
void fw_board_start(void (*tick)(void));
/* Sleeps until the next interrupt; call it in main. */
void fw_board_sleep(void);
/* Returns the time, in the tick. The clock need not match any other: a count of timer interrupts suffices. */
int64_t fw_board_now_us(void);
/* Feeds the watchdog, from the tick. After a few missing ticks the board resets; the device's own watchdog has dropped
 * the torque by then. */
void fw_board_watchdog(void);
/* Stops after an internal error; the board sends no further command. */
_Noreturn void fw_board_panic(const char *why);

/* Receive or send a classical frame, from the tick, in the order of the bus. Return false if none waits or the queue is
 * full. */
bool fw_can_receive(hrt_can_frame *frame);
bool fw_can_send(const hrt_can_frame *frame);
/* Returns false after bus-off; the driver recovers by itself (128 times 11 recessive bits). */
bool fw_can_ok(void);

/* News from the link since the last tick: the newest complete message of each kind, with positions relative to the
 * trocar. */
typedef struct fw_news {
    bool sample, patch, command;
    bool enable, reset, passivity, coupling; /* valid with `command` */
    hrt_extrapolator extrapolator;
} fw_news;
/* Receives from the link, in main. Writes at most one sample and the patch that came with it (`patch` null: no memory
 * for patches). */
void fw_link_receive(int32_t device, fw_news *news, hrt_sample *sample, hrt_patch *patch);
/* Sends the tool's state for the simulation and the controller's status, in the tick. */
void fw_link_send(int32_t device, const hrt_result *result);

/* Handles the core timer's interrupt; named in the vector table. */
void fw_systick(void);

#endif
