/* Instruments of a scene: axes, joints and poses. */
#include "surface.h"

#include <string.h>

tm_tool_pose sim_pose(const sim *s, int instrument, const double joint[SIM_JOINTS], bool active) {
    tm_tool_pose pose = {.roll_rad = joint[HRT_ROLL], .grip = joint[HRT_GRIP], .active = active};
    hrt_tip64(&s->axes[instrument], joint, pose.tip_m);
    for (int a = 0; a < 3; a++) pose.tip_m[a] += s->instrument_def[instrument].trocar_m[a];
    return pose;
}

static bool joints_of_tip(const sim *s, int instrument, const double tip_m[3], double joint[SIM_JOINTS]) {
    double from_trocar[3];
    for (int a = 0; a < 3; a++) from_trocar[a] = tip_m[a] - s->instrument_def[instrument].trocar_m[a];
    return hrt_inverse64(&s->axes[instrument], from_trocar, joint);
}

/* The insertion at which the tip, a sphere, is `above` the place where it first touches. */
static tm_status insert_above(const sim *s, int instrument, const app_pose *pose, double joint[SIM_JOINTS]) {
    const tm_instrument_def *def = &s->instrument_def[instrument];
    double one[SIM_JOINTS], along[3];
    memcpy(one, joint, sizeof one);
    one[2] = 1;
    tm_tool_pose out = sim_pose(s, instrument, one, false);
    for (int a = 0; a < 3; a++) along[a] = out.tip_m[a] - def->trocar_m[a];
    double way = sim_way_to_touch(s->mesh, def->trocar_m, along, def->radius_m), insertion = way - pose->above.si;
    if (way < 0)
        return app_scene_bad(s->scene, pose->above.line,
                             "above: the shaft of instrument %d does not meet the tissue in this direction; turn it "
                             "(pitch, yaw or tip), or give an insertion",
                             instrument);
    if (!(insertion > 1e-3 && insertion <= 0.5))
        return app_scene_bad(s->scene, pose->above.line,
                             "above: the shaft of instrument %d meets the tissue %.4g m from its trocar, so that this "
                             "would be an insertion of %.4g m; keep it between 1 mm and 0.5 m",
                             instrument, way, insertion);
    joint[2] = insertion;
    return 0;
}

tm_status sim_scene_joints(const sim *s, int instrument, const app_pose *pose, double joint[SIM_JOINTS]) {
    joint[0] = pose->pitch.si;
    joint[1] = pose->yaw.si;
    joint[2] = pose->insertion.si;
    joint[3] = pose->roll.si;
    joint[4] = pose->grip.si;
    if (pose->tip.line) joints_of_tip(s, instrument, pose->tip.v, joint);
    return pose->above.line ? insert_above(s, instrument, pose, joint) : 0;
}

tm_tool_pose sim_hand_pose(const sim *s, int instrument, double time_s) {
    double joint[SIM_JOINTS];
    bool pedal = false;
    hrt_hand_target(&s->hand[instrument], s->start_joint[instrument], time_s, joint, &pedal);
    return sim_pose(s, instrument, joint, pedal || s->instrument_def[instrument].mode != TM_TOOL_CAUTERY);
}

/* The scene's hand of an instrument as the virtual device takes it. */
static tm_status make_hand(sim *s, int instrument, const app_hand *hand) {
    const app_waypoint *w = hand->path.item;
    hrt_keyframe *key = app_scene_alloc(s->scene, sizeof *key * (size_t)hand->path.count);
    if (!key) return app_scene_no_memory(&s->scene->host, s->scene->file);
    for (int k = 0; k < hand->path.count; k++) {
        key[k].time_s = w[k].time.si;
        key[k].active = w[k].active.on;
        tm_status rc = sim_scene_joints(s, instrument, &w[k].pose, key[k].joint);
        if (rc) return rc;
    }
    s->hand[instrument] = (hrt_hand_script){.key = key,
                                            .key_count = hand->path.count,
                                            .straight = hand->between.index == 1,
                                            .repeat = hand->repeat.on,
                                            .tremor_m = hand->tremor.line ? hand->tremor_amplitude.si : 0,
                                            .tremor_hz = hand->tremor_frequency.si};
    return 0;
}

tm_status sim_make_instruments(sim *s) {
    tm_status rc = 0;
    s->instrument_count = s->scene->instrument.count;
    for (int i = 0; i < s->instrument_count && !rc; i++) {
        const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
        tm_instrument_def *def = &s->instrument_def[i];
        def->mode = (tm_tool_mode)t->mode.index;
        memcpy(def->trocar_m, t->trocar.v, sizeof def->trocar_m);
        def->radius_m = t->radius.si;
        def->contact_length_m = t->contact_length.si;
        if (t->friction.line && !sim_has(s, "friction"))
            return app_scene_bad(s->scene, t->friction.line,
                                 "instrument %d has coefficients of friction, and the scene does not name the effect; "
                                 "add 'friction:', or remove it here",
                                 i);
        if (!hrt_axes_along64(&s->axes[i], t->axis.v, t->up.v))
            return app_scene_bad(
                s->scene, t->axis.line ? t->axis.line : t->up.line,
                "axis and up give no orientation; give directions of a length near 1 across each other");
        for (int h = 0; h < s->scene->hand.count; h++) {
            const app_hand *hand = (const app_hand *)s->scene->hand.item + h;
            if (hand->instrument.value == i && !rc) rc = make_hand(s, i, hand);
        }
        /* An instrument starts where its hand does, unless it is told otherwise. */
        if (!rc) rc = sim_scene_joints(s, i, &t->start, s->start_joint[i]);
        if (rc) break;
        if (s->hand[i].key && !t->start_here.line)
            memcpy(s->start_joint[i], s->hand[i].key[0].joint, sizeof s->start_joint[i]);
        /* Probe and grasper are in the body from the start; a cautery burns only when told. */
        s->pose[i] = def->pose = sim_pose(s, i, s->start_joint[i], def->mode != TM_TOOL_CAUTERY);
    }
    return rc;
}
