#include "tools.h"

#include <math.h>
#include <string.h>

#include "core/hrt.h"
#include "core/mode.h"

_Static_assert((int)HRT_MODE_PROBE == (int)TM_TOOL_PROBE && (int)HRT_MODE_GRASPER == (int)TM_TOOL_GRASPER &&
                   (int)HRT_MODE_CAUTERY == (int)TM_TOOL_CAUTERY,
               "modes of the library and of messages have the same numbers");

static bool sane(const sim *s, int instrument, const tensormass_tool_state_t *m) {
    const hrt_device_type *device = s->axes[instrument].device;
    if (m->joints != device->joints) return false;
    for (int j = 0; j < SIM_JOINTS; j++) {
        const double low = j < device->joints ? (double)device->joint[j].reach_min : 0,
                     high = j < device->joints ? (double)device->joint[j].reach_max : 0;
        if (!isfinite(m->joint[j]) || m->joint[j] < low || m->joint[j] > high) return false;
    }
    tm_tool_pose pose = sim_pose(s, instrument, m->joint, false);
    for (int a = 0; a < 3; a++) /* larger: controller and scene disagree on the trocar */
        if (!isfinite(m->tip_m[a]) || fabs(m->tip_m[a] - pose.tip_m[a]) > (double)device->rounding_m) return false;
    return m->mode >= 0 && m->mode < HRT_MODE_COUNT && m->state >= 0 && m->state < HRT_STATE_COUNT &&
           (m->active == 0 || m->active == 1);
}

const char *sim_tools_take(sim_tools *t, int instrument, int64_t now_us, const tensormass_tool_state_t *m) {
    sim_tool *tool = &t->tool[instrument];
    if (m->instrument != instrument) {
        tool->foreign++;
        return "its instrument differs from its channel's";
    }
    if (m->device != hrt_device_type_number(t->s->axes[instrument].device)) {
        tool->rejected++;
        return "its device differs from the scene's; correct instruments.device of the scene, or haptic-rt --device-type";
    }
    if (!sane(t->s, instrument, m)) {
        tool->rejected++;
        return "a value is out of range, or its tip differs from the position that its joints give in this scene; see haptic-rt --trocar";
    }
    const hrt_gate_mark mark = {.session = m->session, .utime = m->utime, .seq = (uint32_t)m->seq};
    const hrt_gate_verdict verdict = hrt_gate_accept(&tool->gate, now_us, false, &mark);
    if (!hrt_gate_open(verdict)) {
        ++*(verdict == HRT_GATE_FOREIGN ? &tool->foreign : &tool->late);
        return hrt_gate_text(verdict);
    }
    tool->now = *m;
    tool->seen = true;
    tool->accepted++;
    return NULL;
}

tm_tool_pose sim_tools_target(const sim_tools *t, int instrument) {
    const sim_tool *tool = &t->tool[instrument];
    if (!tool->seen) return t->s->pose[instrument];
    bool always = t->s->instrument_def[instrument].mode != TM_TOOL_CAUTERY;
    tm_tool_pose pose = sim_pose(t->s, instrument, tool->now.joint, always || tool->now.active);
    /* Uses the controller's own tip, so that it gets the same value back; the two agree up to rounding. */
    memcpy(pose.tip_m, tool->now.tip_m, sizeof pose.tip_m);
    pose.grip = fmin(fmax(pose.grip, 0), 1);
    return pose;
}

sim_sends sim_tools_want(const sim_tools *t, int instrument) {
    const sim_tool *tool = &t->tool[instrument];
    sim_sends wanted = tool->seen ? sim_sends_of(tool->now.extrapolator) : SIM_SENDS_FORCE;
    return wanted < t->s->can_send ? wanted : t->s->can_send;
}

int64_t sim_tools_mean_utime(sim_tools *t, int instrument, int32_t substeps, int32_t average) {
    sim_tool *tool = &t->tool[instrument];
    if (!tool->seen) return 0;
    const double *v = t->s->velocity_m_s[instrument];
    double jump_m = t->s->last_s * sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    bool known = tool->used_seen && tool->used_session == tool->now.session && tool->used_utime <= tool->now.utime;
    int64_t end = tool->now.utime, begin = known ? tool->used_utime : end;
    tool->used_seen = true;
    tool->used_utime = end;
    tool->used_session = tool->now.session;
    /* The motion from a previous controller's last pose belongs to no hand: this controller has no time for it. */
    if (!known && jump_m > 1e-3) return 0;
    return end - (int64_t)((double)(end - begin) * (average - 1) / (2.0 * substeps));
}
