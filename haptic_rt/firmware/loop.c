/* The firmware's loop: the tick in the interrupt, checks of received data in main. */
#include "loop.h"

enum { FRAMES_A_TICK_MAX = 64 }; /* a full bus carries 16 in 2 ms; more waits for the next tick */

/* The device is mounted along the board's own axes; the simulation's side rotates positions and forces. */
static const hrt_axes device_axes = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}};

#if FW_PATCHES
static float patch_scratch[HRT_PATCH_COMPLIANCE]; /* shared: patches are checked one after another */
#endif

void fw_loop_init(fw_loop *loop, int64_t session) {
    static hrt_params params;
    hrt_params_default(&params);
    params.period_us = (float)FW_PERIOD_US;
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        fw_device *device = &loop->device[i];
        hrt_init(&device->controller, &params, &device_axes, session);
        hrt_can_exchange_init(&device->exchange, i);
        device->input = (hrt_input){.enable = true, .passivity = true, .extrapolator = HRT_TANGENT};
        device->posted = false;
        device->rejected = 0;
    }
}

/* ---- main ---- */

/* Returns the patch that the controller does not use, to receive into; null without memory for patches. The tick does
 * not change it while nothing is posted. */
static hrt_patch *free_patch(fw_device *device) {
#if FW_PATCHES
    return &device->patch[device->controller.extrapolation.patch == &device->patch[0]];
#else
    (void)device;
    return NULL;
#endif
}

static bool patch_is_good(int32_t index, hrt_patch *patch) {
#if FW_PATCHES
    fw_measure_begin(index, FW_SPAN_PATCH);
    const bool good = hrt_patch_prepare(patch, patch_scratch) == HRT_ACCEPT;
    fw_measure_end(index, FW_SPAN_PATCH);
    return good;
#else
    (void)index;
    (void)patch;
    return false;
#endif
}

static void check(fw_device *device, int32_t index, hrt_patch *patch) {
    fw_news *news = &device->news;
    if (news->sample && hrt_sample_check(&device->sample, &device->controller.params) != HRT_ACCEPT) {
        news->sample = false;
        device->rejected++;
    }
    if (!news->sample) return;
    const bool good = news->patch && patch_is_good(index, patch);
    device->rejected += news->patch && !good;
    device->sample.patch = good ? patch : NULL;
}

void fw_loop_background(fw_loop *loop) {
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        fw_device *device = &loop->device[i];
        if (device->posted) continue; /* the link keeps its newest until the tick has taken the last */
        hrt_patch *patch = free_patch(device);
        device->news = (fw_news){0};
        fw_link_receive(i, &device->news, &device->sample, patch);
        check(device, i, patch);
        __atomic_signal_fence(__ATOMIC_RELEASE); /* on one core, compiler order is sufficient */
        device->posted = device->news.sample || device->news.command;
    }
}

/* ---- interrupt ---- */

static void receive_frames(fw_loop *loop, int64_t now_us) {
    hrt_can_frame frame;
    for (int32_t n = 0; n < FRAMES_A_TICK_MAX && fw_can_receive(&frame); n++) {
        hrt_can_message message;
        hrt_can_unpack(&frame, &message);
        for (int32_t i = 0; i < FW_DEVICES; i++)
            hrt_can_exchange_take(&loop->device[i].exchange, now_us, &message, &loop->device[i].input);
    }
}

/* Returns the newest valid sample, or null. */
static const hrt_sample *take_news(fw_device *device, int64_t now_us) {
    hrt_input *input = &device->input;
    input->reset = false;
    if (!device->posted) return NULL;
    __atomic_signal_fence(__ATOMIC_ACQUIRE);
    const fw_news *news = &device->news;
    if (news->command) {
        input->reset = news->reset;
        input->enable = news->enable;
        input->passivity = news->passivity;
        input->coupling = news->coupling;
        input->extrapolator = news->extrapolator;
        if (news->reset) hrt_can_exchange_reset(&device->exchange, now_us, input);
    }
    device->posted = false;
    return news->sample ? &device->sample : NULL;
}

void fw_loop_tick(fw_loop *loop, int64_t now_us) {
    receive_frames(loop, now_us);
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        fw_device *device = &loop->device[i];
        const hrt_sample *sample = take_news(device, now_us);
        device->input.bus_ok = fw_can_ok();
        fw_measure_begin(i, FW_SPAN_TICK);
        hrt_tick(&device->controller, now_us, &device->input, sample, &device->result);
        fw_measure_end(i, FW_SPAN_TICK);
        hrt_can_frame frame[HRT_CAN_EXCHANGE_FRAMES];
        const int32_t count =
            hrt_can_exchange_frames(&device->exchange, now_us, &device->result, device->input.reset, frame);
        for (int32_t f = 0; f < count; f++) fw_can_send(&frame[f]);
        fw_link_send(i, &device->result);
    }
}
