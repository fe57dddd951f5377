/* The firmware's work for every device on the bus, in two halves: the tick, in the timer's interrupt, and below it the
 * checking of what the simulation sent. The same on the board and, compiled for the host, in the reference of its test.
 * Static memory, bounded loops. */
#ifndef FW_LOOP_H
#define FW_LOOP_H

#include "board.h"
#include "can/exchange.h"

/* Patches: 0 leaves `local_model` without a patch (it runs as `tangent`), 1 keeps one in use and one being received. */
#ifndef FW_PATCHES
#define FW_PATCHES 0
#endif

typedef struct fw_device {
    hrt_controller controller;
    hrt_can_exchange exchange;
    hrt_input input;
    hrt_result result;
    /* from main to the tick: main writes while `posted` is false, the tick reads and clears it */
    volatile bool posted;
    fw_news news;
    hrt_sample sample;
    uint32_t rejected; /* samples and patches that failed their check */
#if FW_PATCHES
    hrt_patch patch[2];
#endif
} fw_device;

typedef struct fw_loop {
    fw_device device[FW_DEVICES];
} fw_loop;

void fw_loop_init(fw_loop *loop, int64_t session);
/* In the interrupt: receive frames, tick, send. */
void fw_loop_tick(fw_loop *loop, int64_t now_us);
/* In main: take what the link brought, check it, post it to the tick. */
void fw_loop_background(fw_loop *loop);

/* Around every hrt_tick and every patch's check, for builds that measure; empty in the product. */
typedef enum fw_span { FW_SPAN_TICK, FW_SPAN_PATCH } fw_span;
void fw_measure_begin(int32_t device, fw_span span);
void fw_measure_end(int32_t device, fw_span span);

#endif
