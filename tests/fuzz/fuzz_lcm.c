/* Undecoded messages to a running controller of haptic-rt are rejected or accepted; its torques stay finite and
 * bounded. An accepted message of any kind encodes to the same bytes. */
#include <math.h>

#include "device/device.h"
#include "fuzz.h"
#include "io/peer.h"

static hrt_node node;
static hrt_device device;
static hrt_loopback loopback;
static hrt_bus ends[2];
static hrt_peer peer;
static app_queue *queue;
static int64_t now;

static void hand(void *user, const double joint[HRT_JOINTS], bool active) {
    (void)user;
    for (int i = 0; i < 5; i++) PROMISE(isfinite(joint[i]));
    hrt_device_hand(&device, joint, active);
}

static void start_loop(void) {
    hrt_loopback_init(&loopback);
    for (int i = 0; i < 2; i++) PROMISE(hrt_bus_open_loopback(&ends[i], &loopback));
    hrt_node_config config = hrt_node_config_default(0);
    config.session = 7;
    config.pose_known = true;
    config.pose = (hrt_pose){{0, 0, 0.1}, {0, 0, -1}, {0, 1, 0}};
    hrt_device_config device_config = hrt_device_config_default(0);
    memset(&node, 0, sizeof node);
    hrt_node_init(&node, &config, &ends[0]);
    hrt_device_init(&device, &device_config, &ends[1]);
    now = 1000000;
}

/* Initial state of every input: the device known, the controller idle. Everything is in these structs. */
static struct warm {
    hrt_node node;
    hrt_device device;
    hrt_loopback loopback;
    hrt_bus ends[2];
    int64_t now;
} * warm;

static void run(int ticks) {
    for (int i = 0; i < ticks; i++) {
        tensormass_tool_state_t tool;
        now += 2000;
        hrt_device_step(&device, now);
        hrt_node_tick(&node, now, &tool);
        for (int k = 0; k < HRT_MOTORS; k++) {
            float torque = node.result.torque[k];
            PROMISE(isfinite(torque) && fabsf(torque) <= node.config.params.torque_max[k] * 1.001f);
            if (node.result.state != HRT_ENGAGED && node.result.state != HRT_STALE) PROMISE(torque == 0);
        }
    }
}

/* Inserts a type's fingerprint, which fuzzing could not guess. */
static void set_fingerprint(app_message_kind kind, uint8_t *bytes, int size) {
    app_message none;
    app_message_empty(kind, &none);
    uint8_t *whole = malloc((size_t)app_message_size(kind, &none));
    PROMISE(app_message_encode(kind, whole, app_message_size(kind, &none), &none) > 8);
    memcpy(bytes, whole, (size_t)(size < 8 ? size : 8));
    free(whole);
}

static void same_again(app_message_kind kind, const uint8_t *bytes, int size) {
    app_message m;
    if (!app_message_decode(kind, bytes, size, &m)) return;
    uint8_t *back = malloc((size_t)size);
    PROMISE(app_message_size(kind, &m) == size && app_message_encode(kind, back, size, &m) == size);
    PROMISE(memcmp(back, bytes, (size_t)size) == 0);
    free(back);
    app_message_cleanup(kind, &m);
}

static void give(app_message_kind kind, const uint8_t *bytes, int size) {
    char channel[APP_CHANNEL_CAPACITY];
    app_channel_name(kind, 0, channel);
    app_queue_set_clock(queue, now);
    same_again(kind, bytes, size);
    app_link_give(peer.link, channel, now, bytes, size);
}

static void open_peer(void) {
    app_topic topic[HRT_PEER_TOPICS];
    app_link_close(peer.link);
    hrt_peer_init(&peer, &(hrt_peer_def){.joints = 5, .node = &node, .hand = hand});
    const app_link_def def = {.topic = topic, .topics = hrt_peer_topics(&peer, topic)};
    peer.link = app_link_join(queue, &def, NULL);
    PROMISE(peer.link != NULL);
}

static void begin(void) {
    if (!warm) {
        queue = app_queue_create(0);
        start_loop();
        run(200);
        warm = malloc(sizeof *warm);
        memcpy(&warm->node, &node, sizeof node);
        warm->device = device;
        warm->loopback = loopback;
        memcpy(warm->ends, ends, sizeof ends);
        warm->now = now;
    }
    memcpy(&node, &warm->node, sizeof node);
    device = warm->device;
    loopback = warm->loopback;
    memcpy(ends, warm->ends, sizeof ends);
    now = warm->now;
    open_peer();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    begin();
    for (int message = 0; message < 8 && b.left; message++) {
        uint8_t head[4];
        fuzz_take(&b, head, sizeof head);
        /* The corpus depends on this order; append further kinds. */
        static const app_message_kind order[] = {APP_FORCE, APP_PATCH,  APP_HAND, APP_SIM_STATUS, APP_COMMAND,
                                                 APP_CUT,   APP_TISSUE, APP_TOOL, APP_CONTROLLER};
        app_message_kind kind = order[head[0] % (sizeof order / sizeof *order)];
        int bytes = (int)(head[1] | (head[2] & 63) << 8);
        app_message none;
        app_message_empty(kind, &none);
        if (head[2] & 64) bytes = app_message_size(kind, &none); /* as long as a real message, the remainder zero */
        uint8_t *copy = malloc((size_t)bytes + !bytes);
        fuzz_take(&b, copy, (size_t)bytes);
        if (!(head[2] & 128)) set_fingerprint(kind, copy, bytes);
        give(kind, copy, bytes);
        free(copy);
        run(1 + head[3] % 16);
    }
    return 0;
}
