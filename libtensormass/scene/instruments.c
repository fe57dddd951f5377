/* Instruments of a scene: axes, joints and poses. */
#include "surface_distance.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Returns a joint's value; 0 if the device lacks it. */
static double joint_of(int32_t role, const double joint[SIM_JOINTS]) { return role < 0 ? 0 : joint[role]; }

tm_tool_pose sim_pose(const sim *s, int instrument, const double joint[SIM_JOINTS], bool active) {
    const hrt_device_type *device = s->axes[instrument].device;
    tm_tool_pose pose = {
        .roll_rad = joint_of(device->roll, joint), .grip = joint_of(device->grip, joint), .active = active};
    hrt_tip64(&s->axes[instrument], joint, pose.tip_m);
    for (int a = 0; a < 3; a++) pose.tip_m[a] += s->instrument_def[instrument].trocar_m[a];
    if (s->instrument_def[instrument].is_free) hrt_direction64(&s->axes[instrument], joint, pose.direction);
    return pose;
}

double sim_shaft_start(const sim *s, int instrument, const tm_tool_pose *pose, double from_m[3], double along[3]) {
    const tm_instrument_def *def = &s->instrument_def[instrument];
    double length = 0, square = 0;
    tm_tool_direction(def, pose, along);
    for (int32_t v = 0; v < s->mesh->vertex_count && def->is_free; v++) {
        double away = 0;
        for (int a = 0; a < 3; a++)
            away += (s->mesh->rest_m[3 * v + a] - pose->tip_m[a]) * (s->mesh->rest_m[3 * v + a] - pose->tip_m[a]);
        length = fmax(length, sqrt(away) + 2 * def->radius_m);
    }
    for (int a = 0; a < 3; a++) {
        const double back = pose->tip_m[a] - def->trocar_m[a];
        square += back * back;
        from_m[a] = def->is_free ? pose->tip_m[a] - length * along[a] : def->trocar_m[a];
    }
    return def->is_free ? length : sqrt(square);
}

bool sim_same_devices(const sim *s) {
    for (int i = 1; i < s->instrument_count; i++)
        if (s->axes[i].device != s->axes[0].device) return false;
    return true;
}

/* Converts the shaft's pitch, yaw and insertion to the device's driven joints. */
static void joints_of_shaft(const sim *s, int instrument, const double shaft[3], double joint[SIM_JOINTS]) {
    const hrt_axes64 *axes = &s->axes[instrument];
    double tip_m[3];
    if (axes->device->insertion >= 0) {
        memcpy(joint, shaft, 3 * sizeof *shaft);
        return;
    }
    hrt_shaft_tip64(axes, shaft, tip_m);
    hrt_inverse64(axes, tip_m, joint);
}

/* Retreat of a free instrument along its shaft, before it moves in. */
static const double FREE_RETREAT_M = 0.1;

tm_tool_pose sim_start_pose_at(const sim *s, int instrument, double insertion_m, bool active) {
    const hrt_axes64 *axes = &s->axes[instrument];
    double joint[SIM_JOINTS], tip_m[3], shaft[3];
    memcpy(joint, s->start_joint[instrument], sizeof joint);
    if (s->instrument_def[instrument].is_free) {
        tm_tool_pose pose = sim_pose(s, instrument, joint, active);
        for (int a = 0; a < 3; a++) pose.tip_m[a] -= FREE_RETREAT_M * pose.direction[a];
        return pose;
    }
    if (axes->device->insertion >= 0)
        joint[axes->device->insertion] = fmin(joint[axes->device->insertion], insertion_m);
    else {
        hrt_tip64(axes, joint, tip_m);
        if (hrt_shaft_of_tip64(axes, tip_m, shaft)) {
            shaft[2] = fmin(shaft[2], insertion_m);
            joints_of_shaft(s, instrument, shaft, joint);
        }
    }
    return sim_pose(s, instrument, joint, active);
}

/* Finds the insertion at which the tip, a sphere, is `above` its first contact. */
static tm_status insert_above(const sim *s, int instrument, const app_pose *pose, double shaft[3]) {
    const tm_instrument_def *def = &s->instrument_def[instrument];
    const double one[3] = {shaft[0], shaft[1], 1};
    double along[3];
    hrt_shaft_tip64(&s->axes[instrument], one, along);
    for (int a = 0; a < 3; a++) along[a] = (along[a] + def->trocar_m[a]) - def->trocar_m[a];
    double way = sim_way_to_touch(s->mesh, def->trocar_m, along, def->radius_m), insertion = way - pose->above.si;
    if (way < 0)
        return app_scene_bad(
            s->scene, pose->above.line,
            "above: the shaft of instrument %d does not meet the tissue in this direction; change pitch, yaw or "
            "tip, or give an insertion",
            instrument);
    if (!(insertion > 1e-3 && insertion <= 0.5))
        return app_scene_bad(
            s->scene, pose->above.line,
            "above: the shaft of instrument %d meets the tissue %.4g m from its trocar, which makes the "
            "insertion %.4g m; keep it between 1 mm and 0.5 m",
            instrument, way, insertion);
    shaft[2] = insertion;
    return 0;
}

/* Sets a joint. A joint that the device lacks must be omitted. */
static tm_status set_joint(const sim *s, int instrument, const app_number *value, int32_t role,
                           double joint[SIM_JOINTS]) {
    if (role >= 0)
        joint[role] = value->si;
    else if (value->si != 0)
        return app_scene_bad(s->scene, value->line, "the device of instrument %d, %s, has no such joint; leave it out",
                             instrument, s->axes[instrument].device->name);
    return 0;
}

/* Moves the tip along its shaft until it is `above` its first contact. */
static tm_status stand_above(const sim *s, int instrument, const app_pose *pose, tm_tool_pose *at) {
    double from_m[3], along[3];
    const double length = sim_shaft_start(s, instrument, at, from_m, along),
                 way = sim_way_to_touch(s->mesh, from_m, along, s->instrument_def[instrument].radius_m);
    if (way < 0 || length > 1)
        return app_scene_bad(
            s->scene, pose->above.line,
            "above: the shaft of instrument %d through this tip does not meet the tissue; change tip, pitch or yaw",
            instrument);
    for (int a = 0; a < 3; a++) at->tip_m[a] = from_m[a] + (way - pose->above.si) * along[a];
    return 0;
}

/* Computes the driven joints and the tilt of a free instrument. */
static tm_status joints_of_free(const sim *s, int instrument, const app_pose *pose, double joint[SIM_JOINTS]) {
    const hrt_axes64 *axes = &s->axes[instrument];
    const double *origin_m = s->instrument_def[instrument].trocar_m, one[3] = {pose->pitch.si, pose->yaw.si, 1};
    tm_tool_pose at = {.active = true};
    const app_number *turned = pose->pitch.si != 0 ? &pose->pitch : &pose->yaw;
    if (turned->si != 0 && !axes->device->tilts)
        return app_scene_bad(
            s->scene, turned->line,
            "the device of instrument %d, %s, reports no direction, so the shaft keeps that of axis; leave pitch and "
            "yaw out, or give the device with its handle",
            instrument, axes->device->name);
    hrt_shaft_tip64(axes, one, at.direction);
    for (int a = 0; a < 3; a++)
        at.tip_m[a] = pose->tip.line ? pose->tip.v[a] : origin_m[a] + pose->insertion.si * at.direction[a];
    tm_status rc = pose->above.line ? stand_above(s, instrument, pose, &at) : 0;
    for (int a = 0; a < 3; a++) at.tip_m[a] -= origin_m[a];
    hrt_inverse64(axes, at.tip_m, joint);
    if (axes->device->tilts) hrt_tilt64(axes, at.direction, &joint[HRT_TILT]);
    return rc;
}

/* Converts a pose of the scene to joints; a pose above the surface needs the mesh. Returns 0 or a status. */
static tm_status sim_scene_joints(const sim *s, int instrument, const app_pose *pose, double joint[SIM_JOINTS]) {
    const hrt_axes64 *axes = &s->axes[instrument];
    double shaft[3] = {pose->pitch.si, pose->yaw.si, pose->insertion.si};
    memset(joint, 0, SIM_JOINTS * sizeof *joint);
    const bool is_free = s->instrument_def[instrument].is_free;
    if (pose->tip.line && !is_free) {
        double from_trocar[3];
        for (int a = 0; a < 3; a++) from_trocar[a] = pose->tip.v[a] - s->instrument_def[instrument].trocar_m[a];
        hrt_shaft_of_tip64(axes, from_trocar, shaft);
    }
    tm_status rc = pose->above.line && !is_free ? insert_above(s, instrument, pose, shaft) : 0;
    if (!rc) rc = set_joint(s, instrument, &pose->roll, axes->device->roll, joint);
    if (!rc) rc = set_joint(s, instrument, &pose->grip, axes->device->grip, joint);
    if (is_free) return rc ? rc : joints_of_free(s, instrument, pose, joint);
    joints_of_shaft(s, instrument, shaft, joint);
    return rc;
}

tm_tool_pose sim_hand_pose(const sim *s, int instrument, double time_s) {
    double joint[SIM_JOINTS];
    bool pedal = false;
    hrt_hand_target(&s->hand[instrument], s->axes[instrument].device, s->start_joint[instrument], time_s, joint,
                    &pedal);
    return sim_pose(s, instrument, joint, pedal || s->instrument_def[instrument].mode != TM_TOOL_CAUTERY);
}

/* Converts an instrument's hand from the scene to the virtual device's form. */
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

static tm_status hang(sim *s, int instrument, const app_instrument *t) {
    const int32_t type = hrt_device_type_find(t->device.s);
    if (type < 0) {
        char names[200] = "";
        for (int32_t k = 0; k < hrt_device_type_count; k++)
            snprintf(names + strlen(names), sizeof names - strlen(names), " %s", hrt_device_types[k]->name);
        return app_scene_bad(s->scene, t->device.line, "device '%s' is not known; use one of%s", t->device.s, names);
    }
    if (t->mount.index == APP_FREE && hrt_device_types[type]->insertion >= 0)
        return app_scene_bad(s->scene, t->device.line ? t->device.line : t->mount.line,
                             "device '%s' turns about a trocar, and instrument %d has none; give a desk device such as "
                             "'device: inverse3_versegrip', or 'mount: trocar'",
                             hrt_device_types[type]->name, instrument);
    if (hrt_axes_along64(&s->axes[instrument], hrt_device_types[type], t->axis.v, t->up.v)) return 0;
    return app_scene_bad(s->scene, t->axis.line ? t->axis.line : t->up.line,
                         "axis and up define no orientation; give perpendicular directions of length near 1");
}

tm_status sim_build_instruments(sim *s) {
    tm_status rc = 0;
    s->instrument_count = s->scene->instrument.count;
    for (int i = 0; i < s->instrument_count && !rc; i++) {
        const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
        tm_instrument_def *def = &s->instrument_def[i];
        def->mode = (tm_tool_mode)t->mode.index;
        def->is_free = t->mount.index == APP_FREE;
        memcpy(def->trocar_m, app_instrument_origin(t)->v, sizeof def->trocar_m);
        def->radius_m = t->radius.si;
        def->contact_length_m = t->contact_length.si;
        if (t->friction.line && !sim_has(s, "friction"))
            return app_scene_bad(
                s->scene, t->friction.line,
                "instrument %d has friction coefficients, and the scene does not name the effect; add 'friction:', "
                "or remove them",
                i);
        rc = hang(s, i, t);
        if (rc) return rc;
        for (int h = 0; h < s->scene->hand.count; h++) {
            const app_hand *hand = (const app_hand *)s->scene->hand.item + h;
            if (hand->instrument.value == i && !rc) rc = make_hand(s, i, hand);
        }
        /* An instrument starts where its hand does, unless it has a start of its own. */
        if (!rc) rc = sim_scene_joints(s, i, &t->start, s->start_joint[i]);
        if (rc) break;
        if (s->hand[i].key && !t->start_here.line)
            memcpy(s->start_joint[i], s->hand[i].key[0].joint, sizeof s->start_joint[i]);
        /* Probe and grasper are active from the start; a cautery only on command. */
        s->pose[i] = def->pose = sim_pose(s, i, s->start_joint[i], def->mode != TM_TOOL_CAUTERY);
    }
    return rc;
}
