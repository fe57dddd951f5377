/* Controller, CAN and mailbox, shared by the Linux loop and lockstep. */
#include "node.h"

#include <math.h>
#include <string.h>

#include "drive.h"
#include "from_message.h"

enum {
    UNREAD = 4,
    FRAMES_PER_TICK = 64,
    TICK_SLACK_US = 4000 /* allowance for the time since the last tick; the next tick checks again */
};

hrt_node_config hrt_node_config_default(int32_t instrument) {
    hrt_node_config config = {.instrument = instrument,
                              .session = 1 + instrument,
                              .pose = {.axis = {0.0, 0.0, 1.0}, .up = {0.0, 1.0, 0.0}},
                              .extrapolator = HRT_ADAPTIVE,
                              .passivity = true,
                              .enable = true};
    hrt_params_default(&config.params);
    return config;
}

static hrt_axes axes_of(const hrt_device_type *device, const hrt_pose *pose) {
    hrt_axes axes;
    const float axis[3] = {(float)pose->axis[0], (float)pose->axis[1], (float)pose->axis[2]};
    const float up[3] = {(float)pose->up[0], (float)pose->up[1], (float)pose->up[2]};
    hrt_axes_along(&axes, device, axis, up);
    axes.is_free = pose->is_free != 0;
    return axes;
}

/* Sets whether a command has the torque at the handle, which depends on the pose. */
static void set_turns(hrt_node *node) {
    const hrt_params *params = &node->config.params;
    node->exchange.turns =
        params->device->tilts && node->controller.axes.is_free && params->handle_torque_max_Nm > 0.0f;
}

void hrt_node_init(hrt_node *node, const hrt_node_config *config, hrt_bus *bus) {
    memset(node, 0, sizeof *node);
    node->config = *config;
    node->bus = bus;
    const hrt_axes axes = axes_of(config->params.device, &config->pose);
    hrt_can_exchange_init(&node->exchange, config->instrument);
    node->exchange.tilts = config->params.device->tilts;
    hrt_init(&node->controller, &config->params, &axes, config->session);
    set_turns(node);
    node->mailbox.write = 1;
    node->mailbox.held = 2;
    node->mailbox.spare = 3;
    node->pose_posted = config->pose;
    node->wish_extrapolator = node->wish_passivity = node->wish_coupling = node->wish_enable = -1;
    node->input.extrapolator = config->extrapolator;
    node->input.passivity = config->passivity;
    node->input.coupling = config->coupling;
    node->input.bus_ok = true;
    hrt_extrapolation_reset(&node->controller.extrapolation, config->extrapolator);
}

/* ---------------------------------------------------------------------------------------------- the posting thread */

static hrt_reject refuse_for(hrt_node *node, hrt_reject why, const char *words) {
    atomic_store(&node->refusal, words);
    if (why == HRT_REJECT_OLD)
        atomic_fetch_add(&node->late, 1);
    else
        atomic_fetch_add(&node->rejected, 1);
    return why;
}

static hrt_reject refuse(hrt_node *node, hrt_reject why) { return refuse_for(node, why, hrt_reject_text(why)); }

/* Returns whether the posted pose is in use; samples are rejected until it is. */
static bool pose_settled(hrt_node *node) { return atomic_load(&node->pose_count) == atomic_load(&node->pose_taken); }

bool hrt_node_in_use(const hrt_node *node) { return atomic_load(&node->in_use); }

bool hrt_node_hears(const hrt_node *node, int64_t session) {
    const hrt_gate *gate = &node->gate;
    if (!gate->known || session == gate->last.session) return true;
    return !hrt_node_in_use(node) && atomic_load(&node->now_us) - gate->heard_us >= HRT_GATE_SILENCE_US;
}

hrt_reject hrt_node_post_patch(hrt_node *node, const tensormass_contact_patch_t *m) {
    if (m->instrument != node->config.instrument || !pose_settled(node) || !hrt_node_hears(node, m->session))
        return refuse(node, HRT_REJECT_FOREIGN);
    node->patch_waits = false;
    hrt_patch *patch = &node->mailbox.slot[node->mailbox.write].patch;
    const hrt_reject verdict = hrt_patch_from_message(m, node->pose_posted.trocar_m, node->scratch, patch);
    if (verdict != HRT_ACCEPT) return refuse(node, verdict);
    node->patch_waits = true;
    node->patch_session = m->session;
    return HRT_ACCEPT;
}

/* Checks order and origin before the mailbox, so that an unread sample is only replaced by a newer one. */
static hrt_reject judge(hrt_node *node, const tensormass_force_sample_t *m, const char **words) {
    const int64_t now_us = atomic_load(&node->now_us);
    const hrt_gate_mark mark = {.session = m->session, .utime = m->tool_utime, .seq = (uint32_t)m->seq};
    if (m->tool_utime > now_us + TICK_SLACK_US) return HRT_REJECT_FUTURE;
    if (m->tool_utime < node->newest_t_us) return HRT_REJECT_OLD;
    const hrt_gate_verdict verdict = hrt_gate_accept(&node->gate, now_us, hrt_node_in_use(node), &mark);
    if (!hrt_gate_open(verdict)) *words = hrt_gate_text(verdict);
    if (verdict == HRT_GATE_FOREIGN || verdict == HRT_GATE_PINNED) return HRT_REJECT_FOREIGN;
    if (!hrt_gate_open(verdict)) return HRT_REJECT_OLD;
    node->newest_t_us = m->tool_utime;
    return HRT_ACCEPT;
}

tensormass_force_sample_t hrt_node_sample_for(const tensormass_tool_state_t *tool, uint32_t seq) {
    return (tensormass_force_sample_t){.utime = tool->utime,
                                       .session = 1,
                                       .tool_session = tool->session,
                                       .tool_utime = tool->utime,
                                       .seq = (int32_t)seq,
                                       .instrument = tool->instrument,
                                       .tip_m = {tool->tip_m[0], tool->tip_m[1], tool->tip_m[2]}};
}

hrt_reject hrt_node_post_sample(hrt_node *node, const tensormass_force_sample_t *m) {
    hrt_mailbox *box = &node->mailbox;
    struct hrt_slot *slot = &box->slot[box->write];
    if (m->instrument != node->config.instrument || !pose_settled(node)) return refuse(node, HRT_REJECT_FOREIGN);
    if (m->tool_session == 0) { /* every simulation starts so; not counted as rejected */
        atomic_store(
            &node->refusal,
            "they answer no controller, as tm-sim does not receive this one's messages; see the messages of tm-sim");
        return HRT_REJECT_FOREIGN;
    }
    if (m->tool_session != node->config.session)
        return refuse_for(node, HRT_REJECT_FOREIGN, "they answer another controller; see the messages of tm-sim");
    hrt_reject verdict = hrt_sample_from_message(m, node->pose_posted.trocar_m, node->config.mode != HRT_MODE_GRASPER,
                                                 &node->config.params, &slot->sample);
    const char *words = NULL;
    if (verdict == HRT_ACCEPT) verdict = judge(node, m, &words);
    if (verdict != HRT_ACCEPT) return refuse_for(node, verdict, words ? words : hrt_reject_text(verdict));
    const bool with_patch =
        node->patch_waits && slot->patch.seq == slot->sample.seq && node->patch_session == m->session;
    node->patch_waits = false;
    slot->sample.patch = with_patch ? &slot->patch : NULL;
    slot->number = ++node->posted;
    box->write = atomic_exchange(&box->between, box->write | UNREAD) & 3u;
    return HRT_ACCEPT;
}

void hrt_node_post_pose(hrt_node *node, const hrt_pose *pose) {
    hrt_axes axes;
    const float axis[3] = {(float)pose->axis[0], (float)pose->axis[1], (float)pose->axis[2]};
    const float up[3] = {(float)pose->up[0], (float)pose->up[1], (float)pose->up[2]};
    if (!pose_settled(node) || !hrt_axes_along(&axes, node->config.params.device, axis, up)) return;
    for (int i = 0; i < 3; i++)
        if (!(fabs(pose->trocar_m[i]) < 1.0e6)) return;
    const bool first = atomic_load(&node->pose_count) == 0 && !node->config.pose_known;
    if (!first && memcmp(pose, &node->pose_posted, sizeof *pose) == 0) return;
    node->pose_posted = *pose;
    atomic_fetch_add(&node->pose_count, 1);
}

void hrt_node_post_command(hrt_node *node, const hrt_command *command) {
    if (command->extrapolator >= 0) atomic_store(&node->wish_extrapolator, command->extrapolator);
    if (command->passivity >= 0) atomic_store(&node->wish_passivity, command->passivity);
    if (command->coupling >= 0) atomic_store(&node->wish_coupling, command->coupling);
    if (command->enable >= 0) atomic_store(&node->wish_enable, command->enable);
    if (command->reset) atomic_store(&node->wish_reset, 1);
}

/* ---------------------------------------------------------------------------------------------- the tick's thread */

static void take_commands(hrt_node *node, int64_t now_us) {
    const int32_t extrapolator = atomic_exchange(&node->wish_extrapolator, -1),
                  passivity = atomic_exchange(&node->wish_passivity, -1);
    const int32_t coupling = atomic_exchange(&node->wish_coupling, -1),
                  enable = atomic_exchange(&node->wish_enable, -1);
    if (extrapolator >= 0 && extrapolator < HRT_EXTRAPOLATOR_COUNT)
        node->input.extrapolator = (hrt_extrapolator)extrapolator;
    if (passivity >= 0) node->input.passivity = passivity != 0;
    if (coupling >= 0) node->input.coupling = coupling != 0;
    if (enable >= 0) node->config.enable = enable != 0;
    const bool in_use = node->controller.state == HRT_ENGAGED || node->controller.state == HRT_STALE;
    node->input.reset = atomic_exchange(&node->wish_reset, 0) == 1 && !in_use;
    if (node->input.reset) hrt_can_exchange_reset(&node->exchange, now_us, &node->input);
    if (!in_use && !pose_settled(node)) {
        node->config.pose = node->pose_posted;
        node->config.pose_known = true;
        node->controller.axes = axes_of(node->config.params.device, &node->config.pose);
        set_turns(node);
        atomic_store(&node->pose_taken, atomic_load(&node->pose_count));
    }
    node->input.enable = node->config.enable && node->config.pose_known;
}

static void take_frames(hrt_node *node, int64_t now_us) {
    if (node->drive) {
        hrt_drive_take(node->drive, now_us, &node->controller, &node->input);
        return;
    }
    hrt_can_frame frame;
    hrt_can_message m;
    for (int i = 0; i < FRAMES_PER_TICK && hrt_bus_receive(node->bus, &frame) > 0; i++) {
        hrt_can_unpack(&frame, &m);
        hrt_can_exchange_take(&node->exchange, now_us, &m, &node->input);
    }
    const bool ok = hrt_bus_state_now(node->bus) < HRT_BUS_OFF;
    if (!ok && node->input.bus_ok) node->exchange.can.bus_off++;
    if (!ok) hrt_bus_recover(node->bus, now_us);
    node->input.bus_ok = ok;
}

static const hrt_sample *take_sample(hrt_mailbox *box) {
    if ((atomic_load(&box->between) & UNREAD) == 0) return NULL;
    box->spare = atomic_exchange(&box->between, box->spare) & 3u;
    return &box->slot[box->spare].sample;
}

/* Separates samples of a gap in seq: replaced in the mailbox (if they come as often as ticks) or lost. The tick needs
 * only the newest: an older one would be rendered for no time. */
static void count_gap(hrt_node *node, uint32_t gap) {
    const uint32_t number = node->mailbox.slot[node->mailbox.spare].number, unread = number - node->taken - 1u;
    node->taken = number;
    node->superseded += unread;
    node->lost += gap > unread ? gap - unread : 0u;
}

static void send_frames(hrt_node *node, int64_t now_us) {
    if (node->drive) {
        hrt_drive_give(node->drive, now_us, &node->result, node->input.reset);
        return;
    }
    hrt_can_frame frame[HRT_CAN_EXCHANGE_FRAMES];
    hrt_result scaled = node->result;
    for (int32_t i = 0; i < HRT_MOTORS; i++) scaled.torque[i] *= hrt_can_torque_scale(node->config.params.device, i);
    const int32_t count = hrt_can_exchange_frames(&node->exchange, now_us, &scaled, node->input.reset, frame);
    for (int32_t i = 0; i < count; i++) hrt_bus_send(node->bus, &frame[i]);
}

static void tell(hrt_node *node, int64_t now_us, tensormass_tool_state_t *tool) {
    const hrt_result *out = &node->result;
    memset(tool, 0, sizeof *tool);
    tool->utime = now_us;
    tool->session = node->config.session;
    tool->seq = (int32_t)++node->tool_seq;
    tool->instrument = (int8_t)node->config.instrument;
    tool->mode = (int8_t)node->config.mode;
    tool->state = (int8_t)out->state;
    tool->active = out->pedal;
    tool->extrapolator = (int8_t)out->extrapolator;
    tool->device = (int8_t)hrt_device_type_number(node->config.params.device);
    tool->joints = (int8_t)node->config.params.device->joints;
    for (int i = 0; i < 3; i++) tool->tip_m[i] = node->config.pose.trocar_m[i] + (double)out->tip_m[i];
    for (int j = 0; j < HRT_JOINTS; j++) tool->joint[j] = (double)out->joint[j];
}

static int64_t stage_done(hrt_node *node, int stage, int64_t since_ns) {
    const int64_t now_ns = node->clock_ns ? node->clock_ns() : 0;
    if (stage >= 0) node->stage_ns[stage] = now_ns - since_ns;
    return now_ns;
}

bool hrt_node_tick(hrt_node *node, int64_t now_us, tensormass_tool_state_t *tool) {
    hrt_mailbox *box = &node->mailbox;
    int64_t clock_ns = stage_done(node, -1, 0);
    atomic_store(&node->now_us, now_us);
    take_commands(node, now_us);
    take_frames(node, now_us);
    clock_ns = stage_done(node, HRT_NODE_RECEIVE, clock_ns);
    const uint32_t lost = node->controller.counters.samples_lost;
    const hrt_sample *newest = take_sample(box);
    hrt_tick(&node->controller, now_us, &node->input, newest, &node->result);
    if (newest) count_gap(node, node->controller.counters.samples_lost - lost);
    atomic_store(&node->in_use, node->result.motors_on);
    if (node->controller.extrapolation.patch == &box->slot[box->spare].patch) {
        const uint32_t freed = box->held; /* the controller now uses the new patch */
        box->held = box->spare;
        box->spare = freed;
    }
    clock_ns = stage_done(node, HRT_NODE_TICK, clock_ns);
    send_frames(node, now_us);
    stage_done(node, HRT_NODE_SEND, clock_ns);
    if (tool) tell(node, now_us, tool);
    return node->input.encoder_us != 0 && node->config.pose_known;
}

void hrt_node_stop(hrt_node *node) {
    if (node->drive) {
        static const hrt_result no_force;
        hrt_drive_give(node->drive, atomic_load(&node->now_us), &no_force, false);
        return;
    }
    hrt_can_frame frame;
    if (hrt_can_exchange_off(&node->exchange, &frame)) hrt_bus_send(node->bus, &frame);
}

void hrt_node_status(const hrt_node *node, tensormass_controller_status_t *status) {
    const hrt_result *out = &node->result;
    const hrt_counters *counters = &node->controller.counters;
    const uint32_t rejected = atomic_load(&node->rejected), late = atomic_load(&node->late);
    const char *fault = out->fault == HRT_FAULT_NONE ? "" : hrt_fault_text(out->fault);
    *status = (tensormass_controller_status_t){
        .utime = node->controller.last_tick_us,
        .session = node->config.session,
        .instrument = (int8_t)node->config.instrument,
        .state = (int8_t)out->state,
        .fault = out->fault,
        .fault_text = (char *)(uintptr_t)fault,
        .limits = (int32_t)out->limits,
        .extrapolator = (char *)(uintptr_t)hrt_extrapolator_name((hrt_extrapolator)out->extrapolator),
        .passivity_on = node->input.passivity,
        .passivity_J = (double)out->passivity_J,
        .sample_age_s = out->sample_age_us < 0 ? -1.0 : 1.0e-6 * (double)out->sample_age_us,
        .ticks = counters->ticks,
        .samples_received = (int64_t)counters->samples_received + rejected + late + node->superseded,
        .samples_late = (int64_t)counters->samples_late + late,
        .samples_lost = node->lost,
        .samples_rejected = (int64_t)counters->samples_rejected + rejected,
        .can_tx = (int64_t)node->bus->tx,
        .can_rx = (int64_t)node->bus->rx,
        .can_errors = (int64_t)node->exchange.can.error + node->exchange.can.corrupt + node->exchange.can.lost +
                      node->exchange.can.repeated};
    for (int i = 0; i < 3; i++) status->force_N[i] = (double)out->force_N[i];
}
