/* The message side of a controller or a device: receives, checks and sends messages. */
#include "peer.h"

#include <math.h>
#include <string.h>

enum { REPLAY_AGE_US = 5000, RESET_EVERY_US = 1000000 };

void hrt_peer_init(hrt_peer *peer, const hrt_peer_def *def) {
    memset(peer, 0, sizeof *peer);
    peer->def = *def;
    peer->sealed = def->key && def->key->known;
}

/* --- receiving --- */

static app_verdict refuse(hrt_peer *peer) {
    atomic_fetch_add(&peer->refused, 1);
    return APP_LEFT;
}

/* Returns whether an authenticated message is a replay. */
static bool heard_before(hrt_peer *peer, app_replay *replay, int64_t session, int32_t seq) {
    return peer->sealed && !app_replay_fresh(replay, session, (uint32_t)seq);
}

/* Adapts a recorded sample: it answers a former controller, so it becomes an answer to this one. Ages among the samples
 * of one recording are kept. */
static void replayed(hrt_peer *peer, tensormass_force_sample_t *m) {
    if (m->tool_session == 0) return; /* the simulation had not received from a controller yet */
    if (m->tool_session != peer->replay_session || m->session != peer->sim_session) {
        peer->replay_session = m->tool_session;
        peer->sim_session = m->session;
        peer->replay_offset_us = app_link_now_us(peer->link) - m->tool_utime - REPLAY_AGE_US;
    }
    m->tool_session = peer->def.node->config.session;
    m->tool_utime += peer->replay_offset_us;
}

static app_verdict take_force(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    hrt_peer *peer = user;
    tensormass_force_sample_t m = *(const tensormass_force_sample_t *)message;
    if (peer->def.replay) replayed(peer, &m);
    hrt_node_post_sample(peer->def.node, &m);
    return APP_TAKEN;
}

static app_verdict take_patch(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    hrt_node_post_patch(((hrt_peer *)user)->def.node, message);
    return APP_TAKEN;
}

static app_verdict take_sim_status(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    hrt_peer *peer = user;
    const tensormass_sim_status_t *m = message;
    const int32_t i = peer->def.instrument;
    if (!hrt_node_hears(peer->def.node, m->session)) return APP_LEFT;
    if (heard_before(peer, &peer->statuses, m->session, m->seq)) return APP_FORGED;
    atomic_store(&peer->heard_session, m->session);
    if (i >= m->instrument_count || peer->def.pose_given) return APP_LEFT;
    hrt_pose pose;
    memcpy(pose.trocar_m, m->trocar_m[i], sizeof pose.trocar_m);
    memcpy(pose.axis, m->axis[i], sizeof pose.axis);
    memcpy(pose.up, m->up[i], sizeof pose.up);
    pose.is_free = m->is_free[i] != 0;
    hrt_node_post_pose(peer->def.node, &pose);
    return APP_TAKEN;
}

/* Returns whether a reset is permitted: not while force is rendered, and only at human rates. */
static bool reset_permitted(hrt_peer *peer) {
    const int64_t now_us = app_link_now_us(peer->link);
    if (hrt_node_in_use(peer->def.node) || (peer->reset_us && now_us - peer->reset_us < RESET_EVERY_US)) {
        refuse(peer);
        return false;
    }
    peer->reset_us = now_us;
    return true;
}

/* Returns whether a command is permitted. With a key it must name this controller and be later than the last one, so a
 * recorded command never is. */
static app_verdict command_permitted(hrt_peer *peer, const tensormass_controller_command_t *m) {
    const bool own = m->session == peer->def.node->config.session;
    if (m->instrument != peer->def.instrument || (!own && (peer->sealed || m->session != 0))) return refuse(peer);
    if (!peer->sealed) return APP_TAKEN;
    if (!hrt_seq_after((uint32_t)m->seq, atomic_load(&peer->command_seq))) return APP_FORGED;
    atomic_store(&peer->command_seq, (uint32_t)m->seq);
    return APP_TAKEN;
}

static app_verdict take_command(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    hrt_peer *peer = user;
    const tensormass_controller_command_t *m = message;
    const app_verdict verdict = command_permitted(peer, m);
    if (verdict != APP_TAKEN) return verdict;
    hrt_extrapolator which = HRT_HOLD;
    hrt_command command = {.extrapolator = -1, .passivity = m->passivity, .coupling = -1, .enable = -1};
    command.reset = m->reset_fault == 1 && reset_permitted(peer);
    if (hrt_extrapolator_find(m->extrapolator, &which)) command.extrapolator = which;
    hrt_node_post_command(peer->def.node, &command);
    return APP_TAKEN;
}

static app_verdict take_hand(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    hrt_peer *peer = user;
    const tensormass_hand_command_t *m = message;
    if (m->instrument != peer->def.instrument) return APP_LEFT;
    if (heard_before(peer, &peer->hands, m->session, m->seq)) return APP_FORGED;
    if (m->joints != peer->def.joints) return APP_LEFT; /* meant for another device */
    for (int j = 0; j < HRT_JOINTS; j++)
        if (!(fabs(m->joint[j]) < 1.0e3)) return APP_LEFT;
    /* In order, even without a key: a late message would move the hand back. */
    const hrt_gate_mark mark = {.session = m->session, .utime = m->utime, .seq = (uint32_t)m->seq};
    if (!hrt_gate_open(hrt_gate_accept(&peer->hand_gate, app_link_now_us(peer->link), false, &mark))) return APP_LEFT;
    peer->def.hand(peer->def.user, m->joint, m->active != 0);
    return APP_TAKEN;
}

int hrt_peer_topics(hrt_peer *peer, app_topic topic[HRT_PEER_TOPICS]) {
    const struct {
        bool wanted;
        app_message_kind kind;
        app_verdict (*take)(void *, int, int64_t, const void *);
    } row[HRT_PEER_TOPICS] = {{peer->def.hand, APP_HAND, take_hand},
                              {peer->def.node, APP_FORCE, take_force},
                              {peer->def.node, APP_PATCH, take_patch},
                              {peer->def.node, APP_COMMAND, take_command},
                              {peer->def.node, APP_SIM_STATUS, take_sim_status}};
    int count = 0;
    for (int k = 0; k < HRT_PEER_TOPICS; k++)
        if (row[k].wanted)
            topic[count++] = (app_topic){.kind = row[k].kind,
                                         .instrument = row[k].kind == APP_SIM_STATUS ? 0 : peer->def.instrument,
                                         .take = row[k].take,
                                         .user = peer};
    return count;
}

/* --- sending --- */

void hrt_peer_send_tool(hrt_peer *peer, const tensormass_tool_state_t *tool) {
    tensormass_tool_state_t m = *tool;
    m.sim_session = atomic_load(&peer->heard_session);
    app_link_publish(peer->link, APP_TOOL, peer->def.instrument, m.utime, &m);
}

void hrt_peer_send_status(hrt_peer *peer, const tensormass_controller_status_t *status) {
    tensormass_controller_status_t m = *status;
    m.seq = (int32_t)++peer->status_seq;
    m.command_seq = (int32_t)atomic_load(&peer->command_seq);
    app_link_publish(peer->link, APP_CONTROLLER, peer->def.instrument, m.utime, &m);
}
