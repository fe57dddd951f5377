/* LCM messages as haptic-rt takes them, undecoded, into a running controller: refused or taken, its torques stay finite
 * and bounded. Other types: a message that its walker calls whole decodes, and encodes into the same bytes. */
#include <math.h>

#include "device/device.h"
#include "fuzz.h"
#include "io/lcm_link.c" /* its handlers are static */
#include "lcm_types/tensormass_cut_event_t.h"
#include "lcm_types/tensormass_tissue_t.h"

static hrt_node node;
static hrt_device device;
static hrt_loopback loopback;
static hrt_bus ends[2];
static hrt_link peer;
static int64_t now;

static void hand(void *user, const double joint[5], bool active) {
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
    peer = (hrt_link){.def = {.node = &node, .hand = hand}};
    now = 1000000;
}

/* Where every input begins: the device known, the controller idle. Everything is in these structs. */
static struct warm {
    hrt_node node;
    hrt_device device;
    hrt_loopback loopback;
    hrt_bus ends[2];
    int64_t now;
} * warm;

static void run(int ticks) {
    for (int i = 0; i < ticks; i++) {
        hrt_tool_state tool;
        now += 2000;
        hrt_device_step(&device, now);
        hrt_node_tick(&node, now, &tool);
        for (int k = 0; k < HRT_MOTORS; k++) {
            float torque = node.output.torque[k];
            PROMISE(isfinite(torque) && fabsf(torque) <= node.config.params.torque_max[k] * 1.001f);
            if (node.output.state != HRT_ENGAGED && node.output.state != HRT_STALE) PROMISE(torque == 0);
        }
    }
}

#define SAME(type, layout)                                                                                             \
    do {                                                                                                               \
        tensormass_##type m;                                                                                           \
        memset(&m, 0, sizeof m);                                                                                       \
        if (!app_wire_sound(layout, bytes, size)) break;                                                               \
        if (tensormass_##type##_decode(bytes, 0, size, &m) != size) break;                                             \
        uint8_t *back = malloc((size_t)size);                                                                          \
        PROMISE(tensormass_##type##_encode(back, 0, size, &m) == size && memcmp(back, bytes, (size_t)size) == 0);      \
        free(back);                                                                                                    \
        tensormass_##type##_decode_cleanup(&m);                                                                        \
    } while (0)

enum { FORCE, PATCH, HAND, STATUS, COMMAND, CUT, TISSUE, KINDS };

/* The fingerprint is put in: guessing it is no test. */
static void set_fingerprint(int kind, uint8_t *bytes, int size) {
    const int64_t prints[KINDS] = {__tensormass_force_sample_t_get_hash(),
                                   __tensormass_contact_patch_t_get_hash(),
                                   __tensormass_hand_command_t_get_hash(),
                                   __tensormass_sim_status_t_get_hash(),
                                   __tensormass_controller_command_t_get_hash(),
                                   __tensormass_cut_event_t_get_hash(),
                                   __tensormass_tissue_t_get_hash()};
    for (int i = 0; i < 8 && i < size; i++) bytes[i] = (uint8_t)((uint64_t)prints[kind] >> (56 - 8 * i));
}

static void give(int kind, uint8_t *bytes, int size) {
    switch (kind) {
    case FORCE: on_force(&peer, "", 0, bytes, size); break;
    case PATCH: on_patch(&peer, "", 0, bytes, size); break;
    case HAND: on_hand(&peer, "", 0, bytes, size); break;
    case STATUS: on_sim_status(&peer, "", 0, bytes, size); break;
    case COMMAND: on_command(&peer, "", 0, bytes, size); break;
    case CUT: SAME(cut_event_t, "25.#*4.4."); break;
    case TISSUE: SAME(tissue_t, "32.#*12.*4.#*12.*1."); break;
    }
}

static void begin(void) {
    if (!warm) {
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
    peer = (hrt_link){.def = {.node = &node, .hand = hand}};
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    begin();
    for (int message = 0; message < 8 && b.left; message++) {
        uint8_t head[4];
        fuzz_take(&b, head, sizeof head);
        int kind = head[0] % KINDS, bytes = (int)(head[1] | (head[2] & 63) << 8);
        bool filled = head[2] & 64; /* as long as a real one, the rest zero */
        if (filled && kind == FORCE) bytes = tensormass_force_sample_t_encoded_size(&(tensormass_force_sample_t){0});
        if (filled && kind == PATCH) bytes = tensormass_contact_patch_t_encoded_size(&(tensormass_contact_patch_t){0});
        if (filled && kind == HAND) bytes = tensormass_hand_command_t_encoded_size(&(tensormass_hand_command_t){0});
        uint8_t *copy = malloc((size_t)bytes + !bytes);
        fuzz_take(&b, copy, (size_t)bytes);
        if (!(head[2] & 128)) set_fingerprint(kind, copy, bytes);
        give(kind, copy, bytes);
        free(copy);
        run(1 + head[3] % 16);
    }
    return 0;
}
