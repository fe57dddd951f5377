#include "control_loops.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "io/profile.h"

enum { SESSION = 1, STATUS_EVERY_US = 100000, MAX_COUNT = 1024 };

/* Warns if samples are older than the controller's limit, beyond which it ramps the force down. */
static tm_status warn_age(const sim *s, const sim_haptics *haptics, const hrt_params *params, double tick_s) {
    const double stale_s = 1e-6 * (double)params->stale_us, late_s = haptics->jitter.si + tick_s;
    const double age_s = (haptics->latency.si + 1) * s->sample_s + late_s, most = (stale_s - late_s) / s->sample_s - 1;
    const int line = haptics->latency.line ? haptics->latency.line : haptics->here.line;
    if (age_s <= stale_s) return 0;
    if (most < 0)
        return app_scene_warn(
            s->scene, line,
            "at a sample period of %.3g ms a force is up to %.3g ms old, and the controller ramps down forces "
            "older than %.3g ms, so the hand feels little or nothing; raise haptics.rate",
            1e3 * s->sample_s, 1e3 * age_s, 1e3 * stale_s);
    return app_scene_warn(
        s->scene, line,
        "haptics.latency = %.3g samples of %.3g ms: a force is up to %.3g ms old, and the controller ramps "
        "down forces older than %.3g ms, so the hand feels little or nothing; give %.2g at most, or raise "
        "haptics.rate",
        haptics->latency.si, 1e3 * s->sample_s, 1e3 * age_s, 1e3 * stale_s, floor(10 * most) / 10);
}

/* Returns the instrument's own profile, else the common one, else null. */
static const app_text *profile_of(const sim_haptics *haptics, const app_instrument *scene) {
    if (scene->profile.line) return &scene->profile;
    return haptics->profile.line ? &haptics->profile : NULL;
}

/* Checks that this instrument's device can be on the bus with its profile. */
static tm_status check_device(const sim *s, int i, const sim_haptics *haptics, const app_instrument *scene) {
    char why[200];
    const int line = scene->device.line ? scene->device.line : scene->here.line;
    if (!hrt_bus_carries(s->axes[i].device, why, sizeof why))
        return app_scene_bad(s->scene, line, "instrument %d: %s, or leave out haptics", i, why);
    if (profile_of(haptics, scene) != &haptics->profile || sim_same_devices(s)) return 0;
    return app_scene_bad(
        s->scene, haptics->profile.line,
        "haptics.profile applies to one type of device, and the instruments have a %s and a %s; give each "
        "its own: instruments: - profile: FILE",
        s->axes[0].device->name, s->axes[1].device->name);
}

static int set_up(sim_control_loops *all, int i, const sim *s, const sim_haptics *haptics, int64_t tick_us) {
    sim_control_loop *t = &all->loop[i];
    const app_instrument *scene = (const app_instrument *)s->scene->instrument.item + i;
    hrt_device_config device = hrt_device_config_of(s->axes[i].device, i);
    hrt_node_config node = hrt_node_config_default(i);
    const app_text *profile = profile_of(haptics, scene);
    if (check_device(s, i, haptics, scene)) return APP_BAD_INPUT;
    if (profile && !hrt_profile_read(profile->s, &device.profile)) return APP_BAD_INPUT;
    node.params = device.profile;
    if (i == 0 && warn_age(s, haptics, &node.params, 1e-6 * (double)tick_us)) return APP_BAD_INPUT;
    node.mode = (hrt_mode)s->instrument_def[i].mode;
    node.session = SESSION;
    node.pose_known = true;
    memcpy(node.pose.trocar_m, app_instrument_origin(scene)->v, sizeof node.pose.trocar_m);
    node.pose.is_free = s->instrument_def[i].is_free;
    memcpy(node.pose.axis, scene->axis.v, sizeof node.pose.axis);
    memcpy(node.pose.up, scene->up.v, sizeof node.pose.up);
    node.extrapolator = (hrt_extrapolator)haptics->extrapolator.index;
    node.passivity = haptics->passivity.on;
    node.enable = true;
    device.session = SESSION;
    device.seed = (uint64_t)haptics->seed.value;
    device.period_us = (double)tick_us;
    node.params.period_us = (float)tick_us;
    for (int j = 0; j < SIM_JOINTS; j++) device.rest[j] = s->start_joint[i][j];
    device.hand = s->hand[i];
    hrt_bus_open_loopback(&t->device_bus, &all->bus);
    hrt_bus_open_loopback(&t->node_bus, &all->bus);
    hrt_device_init(&t->device, &device, &t->device_bus);
    hrt_node_init(&t->node, &node, &t->node_bus);
    return 0;
}

static bool join(sim_control_loops *all, int i, const sim *s, const sim_haptics *haptics, app_queue *queue) {
    hrt_peer *peer = &all->loop[i].peer;
    app_topic topic[HRT_PEER_TOPICS];
    const app_impairments impairments = {.latency_s = haptics->latency.si * s->sample_s,
                                         .jitter_s = haptics->jitter.si,
                                         .loss = haptics->loss.si,
                                         .random = &all->random};
    hrt_peer_init(peer, &(hrt_peer_def){.instrument = i,
                                        .joints = s->axes[i].device->joints,
                                        .node = &all->loop[i].node,
                                        .pose_given = true});
    const app_link_def def = {.topic = topic, .topics = hrt_peer_topics(peer, topic)};
    peer->link = app_link_join(queue, &def, &impairments);
    return peer->link != NULL;
}

int sim_control_loops_open(sim_control_loops *all, const sim *s, const sim_haptics *haptics, int64_t tick_us,
                           app_queue *queue) {
    *all = (sim_control_loops){.count = s->instrument_count, .random = (uint64_t)haptics->seed.value};
    hrt_loopback_init(&all->bus);
    all->loop = calloc((size_t)all->count, sizeof *all->loop);
    int rc = all->loop ? 0 : APP_FAILED;
    for (int i = 0; i < all->count && !rc; i++) {
        rc = set_up(all, i, s, haptics, tick_us);
        if (!rc && !join(all, i, s, haptics, queue)) rc = APP_FAILED;
    }
    return rc;
}

void sim_control_loops_close(sim_control_loops *all) {
    for (int i = 0; all->loop && i < all->count; i++) {
        app_link_close(all->loop[i].peer.link);
        hrt_bus_close(&all->loop[i].node_bus);
        hrt_bus_close(&all->loop[i].device_bus);
    }
    free(all->loop);
    all->loop = NULL;
}

void sim_control_loop_tick(sim_control_loop *t, int64_t now_us) {
    app_link_receive(t->peer.link, 0, MAX_COUNT);
    hrt_device_step(&t->device, now_us);
    if (hrt_node_tick(&t->node, now_us, &t->tool)) hrt_peer_send_tool(&t->peer, &t->tool);
    if (now_us - t->status_us < STATUS_EVERY_US) return;
    tensormass_controller_status_t status;
    hrt_node_status(&t->node, &status);
    hrt_peer_send_status(&t->peer, &status);
    t->status_us = now_us;
}
