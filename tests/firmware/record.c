/* Makes the recording on which the firmware is replayed:   record FILE TICKS VERTICES(0|12|24)
 *
 * Two virtual devices with hands, a bus that loses, repeats and corrupts frames, and a simulation that presses them
 * into a bumpy elastic surface at 25 Hz, a frame late, with samples lost, doubled, reordered and invalid. Every
 * extrapolator gets its share of the ticks, with a fault, a silence of the simulation and a reset in between. All
 * inputs of the firmware's loop are recorded. Seeded: the same file every time. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "device/device.h"
#include "libtensormass/numeric/random.h"
#include "replay.h"

enum { FRAME_TICKS = 20, LATE_FRAMES = 1 };

static struct {
    int64_t now_us;
    int32_t tick, tick_count, vertex_count;
    hrt_loopback wire;
    hrt_bus bus[FW_DEVICES + 1];
    hrt_device device[FW_DEVICES];
    fw_loop loop;
    uint64_t random;
    bool bus_ok;
    struct {
        hrt_extrapolation model;
        hrt_patch patch, sent;
        hrt_sample made, last; /* made: published LATE_FRAMES later; last: published before */
        uint32_t seq;
        bool ready;
    } simulation[FW_DEVICES];
} world;

static uint8_t buffer[REPLAY_TICK_MAX];
static replay_bytes events;

static uint32_t draw(uint32_t below) { return (uint32_t)(num_random64(&world.random) >> 33) % below; }

static void event(uint8_t kind, int32_t device) {
    uint8_t who = (uint8_t)device;
    replay_u8(&events, &kind);
    replay_u8(&events, &who);
}

/* ---- the tissue ---- */

static const float grid_m = 0.004f, depth_m = 0.1f, reach_m = 0.006f, compliance_m_N = 0.003f;

static float surface_z(float x, float y) { return depth_m + 0.0008f * sinf(300.f * x) * cosf(260.f * y); }

/* Makes a grid of nx by ny vertices around the tip, aligned with the surface's own; its compliance is an exponential
 * of distance (positive definite). */
static void make_patch(hrt_patch *patch, const float tip_m[3], uint32_t seq) {
    const int32_t nx = world.vertex_count == 12 ? 4 : 6, ny = world.vertex_count == 12 ? 3 : 4;
    const float x0 = grid_m * (roundf(tip_m[0] / grid_m) - 0.5f * (float)(nx - 1)),
                y0 = grid_m * (roundf(tip_m[1] / grid_m) - 0.5f * (float)(ny - 1));
    memset(patch, 0, sizeof *patch);
    *patch = (hrt_patch){.seq = seq,
                         .topology_revision = 1,
                         .vertex_count = nx * ny,
                         .contact_compliance_m_N = 0.001f,
                         .radius_m = 0.0025f,
                         .contact_length_m = 0.05f};
    for (int32_t v = 0; v < nx * ny; v++) {
        const float x = x0 + grid_m * (float)(v % nx), y = y0 + grid_m * (float)(v / nx);
        patch->vertex_m[3 * v] = x;
        patch->vertex_m[3 * v + 1] = y;
        patch->vertex_m[3 * v + 2] = surface_z(x, y);
    }
    for (int32_t j = 0; j + 1 < ny; j++)
        for (int32_t i = 0; i + 1 < nx; i++) {
            const int32_t a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
            const int32_t corner[6] = {a, c, b, b, c, d}; /* outward is -z, towards the trocar */
            for (int32_t k = 0; k < 6; k++) patch->triangle[3 * patch->triangle_count + k] = (uint8_t)corner[k];
            patch->triangle_count += 2;
        }
    float *entry = patch->compliance_m_N;
    for (int32_t row = 0; row < 3 * nx * ny; row++)
        for (int32_t column = row; column < 3 * nx * ny; column++) {
            const float *p = &patch->vertex_m[row - row % 3], *q = &patch->vertex_m[column - column % 3];
            const float distance = sqrtf((p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]));
            *entry++ = row % 3 == column % 3 ? compliance_m_N * expf(-distance / reach_m) : 0;
        }
}

/* Models jaws that have closed near the tip and pull: a vertex follows the less, the farther it is; the last one is
 * at the tip. */
static void grasp(hrt_patch *patch, const float tip_m[3]) {
    static float own[HRT_PATCH_COMPLIANCE];
    const int32_t before = 3 * patch->vertex_count, n = before - 3;
    memcpy(own, patch->compliance_m_N, sizeof own);
    patch->vertex_count--, patch->triangle_count--;
    patch->grasped = 1u << patch->vertex_count;
    const float carried_m = tip_m[2] + patch->radius_m - surface_z(tip_m[0], tip_m[1]);
    float *entry = patch->compliance_m_N, near[HRT_PATCH_MAX_VERTICES];
    for (int32_t v = 0; v < patch->vertex_count; v++) {
        const float x = patch->vertex_m[3 * v] - tip_m[0], y = patch->vertex_m[3 * v + 1] - tip_m[1];
        near[v] = expf(-sqrtf(x * x + y * y) / reach_m);
        patch->vertex_m[3 * v + 2] += near[v] * carried_m;
        if (x * x + y * y < grid_m * grid_m) patch->grasped |= 1u << v;
    }
    for (int32_t row = 0; row < n; row++) {
        for (int32_t column = row; column < n; column++)
            *entry++ = own[row * (2 * before - row - 1) / 2 + column] * (1 - near[row / 3]) * (1 - near[column / 3]);
        for (int32_t c = 0; c < 3; c++) *entry++ = row % 3 == c ? near[row / 3] : 0;
    }
    for (int32_t c = 0; c < 6; c++) *entry++ = c == 0 || c == 3 || c == 5 ? -300.f : 20.f;
    for (int32_t c = 0; c < 3; c++) {
        patch->vertex_m[n + c] = tip_m[c];
        patch->rest_m[n + c] = -300.f * (tip_m[c] - (c == 2 ? depth_m : 0));
    }
}

/* Computes the sample of a quasi-static simulation at this tip: the contact law on its own patch, stiffness by
 * differences. */
static void solve(int32_t index, const hrt_params *params, hrt_sample *sample) {
    static float scratch[HRT_PATCH_COMPLIANCE];
    hrt_extrapolation *model = &world.simulation[index].model;
    hrt_patch *patch = &world.simulation[index].patch;
    make_patch(patch, sample->tip_m, sample->seq);
    sample->unilateral = sample->seq % 8 < 5;
    if (!sample->unilateral) grasp(patch, sample->tip_m);
    if (hrt_patch_prepare(patch, scratch) != HRT_ACCEPT) {
        fprintf(stderr, "record: the recorder's own patch is refused\n");
        exit(1);
    }
    sample->patch = patch;
    hrt_extrapolation_reset(model, HRT_LOCAL_MODEL);
    hrt_extrapolation_sample(model, params, sample);
    for (int32_t settle = 0; settle < 4; settle++)
        hrt_extrapolation_force(model, params, sample->t_us, sample->tip_m, sample->force_N);
    for (int32_t column = 0; column < 3; column++) {
        const float step = 2e-5f;
        float tip[3] = {sample->tip_m[0], sample->tip_m[1], sample->tip_m[2]}, more[3], less[3];
        tip[column] += step;
        hrt_extrapolation_force(model, params, sample->t_us, tip, more);
        tip[column] -= 2 * step;
        hrt_extrapolation_force(model, params, sample->t_us, tip, less);
        for (int32_t row = 0; row < 3; row++)
            sample->stiffness_N_m[3 * row + column] = (more[row] - less[row]) / (2 * step);
    }
    sample->stiffness_kind = 2;
}

static void simulate(int32_t index) {
    const fw_device *device = &world.loop.device[index];
    hrt_sample *made = &world.simulation[index].made;
    *made = (hrt_sample){.session = 7,
                         .tool_session = device->controller.session,
                         .t_us = world.now_us,
                         .seq = ++world.simulation[index].seq,
                         .topology_revision = 1,
                         .unilateral = true};
    memcpy(made->tip_m, device->result.tip_m, sizeof made->tip_m);
    if (world.vertex_count)
        solve(index, &device->controller.params, made);
    else {
        const float deep = made->tip_m[2] + 0.0025f - surface_z(made->tip_m[0], made->tip_m[1]);
        made->force_N[2] = deep > 0 ? -400.f * deep : 0;
        made->stiffness_N_m[8] = deep > 0 ? -400.f : 0;
        made->stiffness_kind = 1;
    }
    world.simulation[index].ready = true;
}

/* ---- board.h: records the inputs of the loop ---- */

void fw_board_start(void (*tick)(void)) { (void)tick; }
void fw_board_sleep(void) {}
int64_t fw_board_now_us(void) { return world.now_us; }
void fw_board_watchdog(void) {}
_Noreturn void fw_board_panic(const char *why) {
    fprintf(stderr, "record: %s\n", why);
    exit(1);
}
bool fw_can_ok(void) { return world.bus_ok; }
bool fw_can_send(const hrt_can_frame *frame) { return hrt_bus_send(&world.bus[FW_DEVICES], frame) > 0; }
void fw_link_send(int32_t device, const hrt_result *result) {
    (void)device;
    (void)result;
}
void fw_measure_begin(int32_t device, fw_span span) {
    (void)device;
    (void)span;
}
void fw_measure_end(int32_t device, fw_span span) {
    (void)device;
    (void)span;
}

bool fw_can_receive(hrt_can_frame *frame) {
    static hrt_can_frame again;
    static bool repeat;
    if (repeat) {
        repeat = false;
        *frame = again;
    } else {
        do {
            if (hrt_bus_receive(&world.bus[FW_DEVICES], frame) <= 0) return false;
        } while (draw(200) == 0); /* lost */
        if (draw(300) == 0) frame->data[draw(8)] ^= (uint8_t)(1 + draw(255));
        if (draw(500) == 0) frame->id = 0x7F0u;
        again = *frame;
        repeat = draw(300) == 0;
    }
    event(EVENT_FRAME, 0);
    replay_frame(&events, frame);
    return true;
}

static void commands(int32_t device, fw_news *news) {
    const int32_t share = world.tick_count / HRT_EXTRAPOLATOR_COUNT, which = world.tick / share,
                  into = world.tick % share;
    const bool after_fault = which == HRT_BROYDEN && into == share / 2;
    if (into != 0 && into != share / 2 && into != 3 * share / 4 && !after_fault) return;
    *news = (fw_news){.command = true,
                      .enable = true,
                      .reset = after_fault,
                      .passivity = into >= share / 2,
                      .coupling = into >= 3 * share / 4,
                      .extrapolator = (hrt_extrapolator)(which < HRT_EXTRAPOLATOR_COUNT ? which : HRT_TANGENT)};
    event(EVENT_COMMAND, device);
    replay_command(&events, news);
}

static bool silent(void) {
    const int32_t share = world.tick_count / HRT_EXTRAPOLATOR_COUNT, which = world.tick / share,
                  into = world.tick % share;
    return which == HRT_TIME && into > share / 2 && into < share / 2 + 150;
}

void fw_link_receive(int32_t device, fw_news *news, hrt_sample *sample, hrt_patch *patch) {
    commands(device, news);
    if (world.tick % FRAME_TICKS != FRAME_TICKS - 1 || !world.simulation[device].ready) return;
    hrt_sample *made = &world.simulation[device].made, *last = &world.simulation[device].last;
    const bool doubled = draw(15) == 0, lost = draw(15) == 0 || silent();
    const hrt_sample newest = doubled && last->seq ? *last : *made;
    *last = *made;
    world.simulation[device].sent = world.simulation[device].patch;
    simulate(device);
    if (lost) return;
    *sample = newest;
    if (draw(25) == 0) sample->force_N[draw(3)] = draw(2) ? NAN : 1e9f;
    if (newest.patch && !doubled) {
        *patch = world.simulation[device].sent;
        if (draw(15) == 0) patch->triangle[draw(6)] = 200;
        event(EVENT_PATCH, device);
        replay_patch(&events, patch);
        news->patch = true;
    }
    event(EVENT_SAMPLE, device);
    replay_sample(&events, sample);
    news->sample = true;
}

/* ---- hands ---- */

/* Presses in, slides across the bumps, pulls out, returns elsewhere: pitch, yaw, insertion. */
static const hrt_keyframe strokes[] = {
    {.time_s = 0.0, .joint = {0.00, 0.00, 0.092}},   {.time_s = 0.25, .joint = {0.02, 0.01, 0.104}},
    {.time_s = 0.6, .joint = {-0.03, 0.05, 0.105}},  {.time_s = 0.9, .joint = {0.05, 0.02, 0.106}},
    {.time_s = 1.1, .joint = {0.05, 0.00, 0.094}},   {.time_s = 1.3, .joint = {0.01, -0.04, 0.103}},
    {.time_s = 1.6, .joint = {-0.05, -0.01, 0.107}}, {.time_s = 1.8, .joint = {0.00, 0.00, 0.092}},
};

static void set_up(void) {
    hrt_loopback_init(&world.wire);
    for (int32_t i = 0; i <= FW_DEVICES; i++)
        if (!hrt_bus_open_loopback(&world.bus[i], &world.wire)) fw_board_panic("loop-back bus is full");
    for (int32_t i = 0; i < FW_DEVICES; i++) {
        hrt_device_config config = hrt_device_config_default(i);
        config.hand = (hrt_hand_script){.key = strokes,
                                        .key_count = sizeof strokes / sizeof strokes[0],
                                        .repeat = true,
                                        .tremor_m = 4e-5,
                                        .tremor_hz = 9};
        memcpy(config.rest, strokes[0].joint, sizeof config.rest);
        config.start_us = 300000 * (i + 1);
        hrt_device_init(&world.device[i], &config, &world.bus[i]);
    }
    world.bus_ok = true;
    world.random = 11;
    fw_loop_init(&world.loop, 1);
}

static void tick(FILE *file) {
    const int32_t share = world.tick_count / HRT_EXTRAPOLATOR_COUNT;
    const int32_t fault_at = HRT_BROYDEN * share + share / 4;
    events = (replay_bytes){.at = buffer, .end = buffer + sizeof buffer, .write = true};
    const bool bus_ok = world.tick < fault_at || world.tick >= fault_at + 10;
    if (bus_ok != world.bus_ok) event(EVENT_BUS, bus_ok);
    world.bus_ok = bus_ok;
    if (world.tick == 1)
        for (int32_t i = 0; i < FW_DEVICES; i++) simulate(i);
    fw_loop_background(&world.loop);
    world.now_us += FW_PERIOD_US;
    for (int32_t i = 0; i < FW_DEVICES; i++) hrt_device_step(&world.device[i], world.now_us);
    fw_loop_tick(&world.loop, world.now_us);
    const uint32_t size = (uint32_t)(events.at - buffer);
    if (events.failed || fwrite(&size, 4, 1, file) != 1 || fwrite(buffer, 1, size, file) != size)
        fw_board_panic("the recording cannot be written");
}

int main(int argc, char **argv) {
    if (argc != 4) return fprintf(stderr, "usage: record FILE TICKS 0|12|24\n"), 2;
    FILE *file = fopen(argv[1], "wb");
    if (!file) return perror(argv[1]), 1;
    world.tick_count = atoi(argv[2]);
    world.vertex_count = atoi(argv[3]);
    set_up();
    for (world.tick = 0; world.tick < world.tick_count; world.tick++) tick(file);
    return fclose(file) ? 1 : 0;
}
