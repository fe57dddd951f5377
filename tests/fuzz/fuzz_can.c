/* Random CAN frames at random times to a controller and a device. Unpacked frames pack to the same bytes; torques
 * are finite and within the profile; force is only in `engaged` and `stale`. */
#include <math.h>

#include "device/device.h"
#include "fuzz.h"
#include "io/node.h"

static void round_trip(const hrt_can_frame *frame) {
    hrt_can_message message, again;
    hrt_can_frame back;
    hrt_can_unpack(frame, &message);
    if (message.kind <= HRT_CAN_ERROR_FRAME || !hrt_can_pack(&message, &back)) return;
    PROMISE(back.id == frame->id);
    hrt_can_unpack(&back, &again);
    PROMISE(again.kind == message.kind && again.instrument == message.instrument && again.counter == message.counter);
    PROMISE(memcmp(again.count, message.count, sizeof again.count) == 0 && again.state == message.state &&
            again.fault == message.fault);
    for (int i = 0; i < HRT_MOTORS; i++) PROMISE(again.torque[i] == message.torque[i]);
    for (int i = 0; i < 3; i++) PROMISE(again.handle_Nm[i] == message.handle_Nm[i]);
}

static void check_output(const hrt_node *node) {
    for (int i = 0; i < HRT_MOTORS; i++) {
        float torque = node->result.torque[i];
        PROMISE(isfinite(torque) && fabsf(torque) <= node->config.params.torque_max[i] * 1.001f);
        if (node->result.state != HRT_ENGAGED && node->result.state != HRT_STALE) PROMISE(torque == 0);
    }
}

static hrt_can_frame take_frame(fuzz_bytes *b) {
    hrt_can_frame frame = {0};
    uint8_t head[4];
    fuzz_take(b, head, sizeof head);
    frame.id = (uint32_t)head[0] | (uint32_t)head[1] << 8;
    frame.flags = head[2] & (HRT_CAN_EXTENDED | HRT_CAN_REMOTE | HRT_CAN_ERROR);
    frame.length = head[3] % 9;
    if (frame.flags & HRT_CAN_EXTENDED) frame.id |= (uint32_t)head[3] << 16;
    fuzz_take(b, frame.data, frame.length);
    return frame;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static hrt_node node;
    static hrt_device device;
    static hrt_loopback loopback;
    fuzz_bytes b = {data, size};
    hrt_bus ends[3];
    hrt_loopback_init(&loopback);
    for (int i = 0; i < 3; i++) PROMISE(hrt_bus_open_loopback(&ends[i], &loopback));
    hrt_node_config config = hrt_node_config_default(0);
    config.session = 7;
    config.pose_known = true;
    config.pose = (hrt_pose){{0, 0, 0.1}, {0, 0, -1}, {0, 1, 0}};
    hrt_device_config device_config = hrt_device_config_default(0);
    hrt_node_init(&node, &config, &ends[0]);
    hrt_device_init(&device, &device_config, &ends[1]);
    int64_t now_us = 1000000;
    bool with_device = fuzz_u8(&b) & 1;
    for (int tick = 0; tick < 400 && b.left; tick++) {
        uint8_t what = fuzz_u8(&b);
        now_us += what & 128 ? 2000 : (int64_t)(what & 15) * 700; /* time may stand still, too */
        for (int i = 0; i < (what >> 4 & 7); i++) {
            hrt_can_frame frame = take_frame(&b);
            round_trip(&frame);
            hrt_bus_send(&ends[2], &frame);
        }
        if (with_device) {
            hrt_device_step(&device, now_us);
            for (int i = 0; i < HRT_JOINTS; i++) PROMISE(isfinite(device.joint[i]));
            for (int i = 0; i < HRT_MOTORS; i++) PROMISE(isfinite(device.torque[i]));
        }
        tensormass_tool_state_t tool;
        hrt_node_tick(&node, now_us, &tool);
        check_output(&node);
    }
    for (int i = 0; i < 3; i++) hrt_bus_close(&ends[i]);
    return 0;
}
