/* The firmware's work, once a tick, for every device on the bus: the same on the board and, compiled for the host, in the reference of
 * its test. Static memory, bounded loops. */
#ifndef FW_LOOP_H
#define FW_LOOP_H

#include "board.h"
#include "can/link.h"

/* Patches: 0 leaves `contact` without a patch (it runs as `tangent`), 1 keeps one in use and one being received. */
#ifndef FW_PATCHES
#define FW_PATCHES 0
#endif

typedef struct fw_device {
    hrt_controller controller;
    hrt_link link;
    hrt_input input;
    hrt_output output;
    uint32_t rejected; /* samples and patches that failed their check */
#if FW_PATCHES
    hrt_patch patch[2];
#endif
} fw_device;

typedef struct fw_loop {
    fw_device device[FW_DEVICES];
    uint32_t missed_ticks;
} fw_loop;

void fw_loop_init(fw_loop *loop, int64_t session);
/* Receive, tick, send. `late_ticks`: timer interrupts beyond the one that woke us. */
void fw_loop_tick(fw_loop *loop, int64_t now_us, uint32_t late_ticks);

/* Around every hrt_tick, for builds that measure; empty in the product. */
void fw_measure_begin(int32_t device);
void fw_measure_end(int32_t device);

#endif
