#include "loop.h"

enum { FRAMES_A_TICK_MAX = 64 }; /* a full bus carries 16 in 2 ms; more waits for the next tick */

/* The device hangs along the board's own axes; the simulation's side turns positions and forces. */
static const hrt_frame device_axes = {{1, 0, 0, 0, 1, 0, 0, 0, 1}};

#if FW_PATCHES
static float patch_scratch[HRT_PATCH_COMPLIANCE]; /* one for all: patches are checked one after the other */
#endif

void fw_loop_init(fw_loop *loop, int64_t session) {
    hrt_params params;
    hrt_params_default(&params);
    loop->missed_ticks = 0;
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        fw_device *device = &loop->device[i];
        hrt_init(&device->controller, &params, &device_axes, session);
        hrt_link_init(&device->link, i);
        device->input = (hrt_input){.enable = true, .extrapolator = HRT_TANGENT};
        device->rejected = 0;
    }
}

static void receive_frames(fw_loop *loop, int64_t now_us) {
    hrt_can_frame frame;
    for (int32_t n = 0; n < FRAMES_A_TICK_MAX && fw_can_receive(&frame); n++) {
        hrt_can_message message;
        hrt_can_unpack(&frame, &message);
        for (int32_t i = 0; i < FW_DEVICES; i++) hrt_link_take(&loop->device[i].link, now_us, &message, &loop->device[i].input);
    }
}

/* The one that the controller does not hold, to be received into. Null: this firmware has no room for patches. */
static hrt_patch *free_patch(fw_device *device) {
#if FW_PATCHES
    return &device->patch[device->controller.extrapolation.patch == &device->patch[0]];
#else
    (void)device;
    return NULL;
#endif
}

static bool patch_is_good(hrt_patch *patch) {
#if FW_PATCHES
    return hrt_patch_prepare(patch, patch_scratch) == HRT_ACCEPT;
#else
    (void)patch;
    return false;
#endif
}

/* The newest good sample into `sample`; false when none came. */
static bool receive_sample(fw_device *device, int32_t index, hrt_sample *sample) {
    fw_news news = {0};
    hrt_patch *patch = free_patch(device);
    fw_link_receive(index, &news, sample, patch);
    device->input.reset = news.command && news.reset;
    if (news.command) {
        device->input.enable = news.enable;
        device->input.passivity = news.passivity;
        device->input.coupling = news.coupling;
        device->input.extrapolator = news.extrapolator;
    }
    if (!news.sample) return false;
    if (hrt_sample_check(sample, &device->controller.params) != HRT_ACCEPT) {
        device->rejected++;
        return false;
    }
    const bool good = news.patch && patch_is_good(patch);
    device->rejected += news.patch && !good;
    sample->patch = good ? patch : NULL;
    return true;
}

void fw_loop_tick(fw_loop *loop, int64_t now_us, uint32_t late_ticks) {
    loop->missed_ticks += late_ticks;
    receive_frames(loop, now_us);
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        fw_device *device = &loop->device[i];
        hrt_sample sample;
        const bool fresh = receive_sample(device, i, &sample);
        device->input.bus_ok = fw_can_ok();
        fw_measure_begin(i);
        hrt_tick(&device->controller, now_us, &device->input, fresh ? &sample : NULL, &device->output);
        fw_measure_end(i);
        hrt_can_frame frame[HRT_LINK_FRAMES];
        const int32_t count = hrt_link_frames(&device->link, now_us, &device->output, device->input.reset, frame);
        for (int32_t f = 0; f < count; f++) fw_can_send(&frame[f]);
        fw_link_send(i, &device->output);
    }
}
