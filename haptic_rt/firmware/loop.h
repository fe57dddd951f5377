/* The firmware's loop over all devices on the bus: the tick in the timer's interrupt, and checks of the simulation's
 * data below it. The board and the test's reference on the host share this code. Static memory, bounded loops. */
#ifndef FW_LOOP_H
#define FW_LOOP_H

#include "board.h"
#include "can/exchange.h"

/* 0: no patches, `local_model` runs as `tangent`; 1: one patch in use and one being received. */
#ifndef FW_PATCHES
#define FW_PATCHES 0
#endif

typedef struct fw_device {
    hrt_controller controller;
    hrt_can_exchange exchange;
    hrt_input input;
    hrt_result result;
    /* from main to the tick: main writes while `posted` is false; the tick reads, then clears it */
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
/* Receives frames, ticks and sends, in the interrupt. */
void fw_loop_tick(fw_loop *loop, int64_t now_us);
/* Receives from the link, checks, and posts to the tick, in main. */
void fw_loop_background(fw_loop *loop);

/* Called around every hrt_tick and every patch check, for builds that measure; empty in the product. */
typedef enum fw_span { FW_SPAN_TICK, FW_SPAN_PATCH } fw_span;
void fw_measure_begin(int32_t device, fw_span span);
void fw_measure_end(int32_t device, fw_span span);

#endif
