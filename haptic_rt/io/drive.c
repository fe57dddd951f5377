/* The tick's side of a drive, and the stages that all drivers share. */
#include "drive.h"

#include <math.h>
#include <string.h>

enum { UNREAD = 4 };
static const double REACH_MAX_M = 1.0, JOINT_MAX = 100.0;

/* ---------------------------------------------------------------------------------------------- the driver's thread */

void hrt_drive_start(hrt_drive *d, const hrt_device_type *device) {
    d->type = device;
    d->force_max_N = device->force_max_N;
    d->state_write = d->command_write = 0;
    d->state_read = d->command_read = 1;
    atomic_store(&d->state_between, 2);
    atomic_store(&d->command_between, 2);
}

void hrt_drive_up(hrt_drive *d, bool up, const char *event) {
    if (up && !atomic_load(&d->up)) atomic_fetch_add(&d->session, 1);
    atomic_store(&d->up, up);
    if (event) atomic_store(&d->event, event);
}

void hrt_drive_fail(hrt_drive *d, hrt_drive_fault fault, const char *event) {
    int none = HRT_DRIVE_FINE;
    atomic_compare_exchange_strong(&d->fault, &none, (int)fault);
    if (event) atomic_store(&d->event, event);
}

static bool has_joints(const hrt_drive *d) { return d->driver && d->driver->joints; }

void hrt_drive_refuse(hrt_drive *d) {
    atomic_fetch_add(&d->refused, 1);
    if (++d->refused_in_a_row >= HRT_DRIVE_REFUSED_MAX) hrt_drive_fail(d, HRT_DRIVE_NONSENSE, NULL);
}

static bool plausible(const hrt_drive *d, const hrt_drive_state *s) {
    for (int i = 0; i < 3; i++)
        if (!(fabs(s->cursor_m[i]) <= (has_joints(d) ? JOINT_MAX : REACH_MAX_M))) return false;
    for (int i = 0; i < 4; i++)
        if (!(fabs(s->orientation[i]) <= 1.01)) return false;
    return s->time_us > 0 && s->trigger <= 1.0;
}

bool hrt_drive_post(hrt_drive *d, const hrt_drive_state *state) {
    if (!plausible(d, state)) return hrt_drive_refuse(d), false;
    d->refused_in_a_row = 0;
    d->state[d->state_write] = *state;
    d->state_write = atomic_exchange(&d->state_between, d->state_write | UNREAD) & 3u;
    atomic_store(&d->state_us, state->time_us);
    atomic_fetch_add(&d->states, 1);
    return true;
}

static float size_of(const float a[3]) { return sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

void hrt_drive_force(hrt_drive *d, int64_t now_us, float force_N[3]) {
    float torque_Nm[3];
    hrt_drive_wrench(d, now_us, force_N, torque_Nm);
}

void hrt_drive_wrench(hrt_drive *d, int64_t now_us, float force_N[3], float torque_Nm[3]) {
    if (atomic_load(&d->command_between) & UNREAD)
        d->command_read = atomic_exchange(&d->command_between, d->command_read) & 3u;
    const hrt_drive_command *c = &d->command[d->command_read];
    const bool silent = now_us - c->time_us > HRT_DRIVE_SILENCE_US ||
                        now_us - atomic_load(&d->state_us) > HRT_DRIVE_SILENCE_US || atomic_load(&d->fault);
    const float size = size_of(c->force_N), turn_Nm = size_of(c->torque_Nm);
    const bool good = isfinite(size) && isfinite(turn_Nm) && !silent;
    if (!good && size > 0.0f) atomic_fetch_add(&d->withheld, 1);
    /* Scales the vector down and keeps its direction: a force cut to zero at a limit would be a step for the hand. */
    const float most = d->force_max_N, turn_most_Nm = d->type->handle_torque_max_Nm;
    float share = !has_joints(d) && size > most ? most / size : 1.0f;
    for (int i = 0; i < 3 && has_joints(d); i++)
        if (share * fabsf(c->force_N[i]) > d->type->torque_max[i])
            share = d->type->torque_max[i] / fabsf(c->force_N[i]);
    if (share * turn_Nm > turn_most_Nm) share = turn_most_Nm / turn_Nm;
    for (int i = 0; i < 3; i++) force_N[i] = good ? share * c->force_N[i] : 0.0f;
    for (int i = 0; i < 3; i++) torque_Nm[i] = good ? share * c->torque_Nm[i] : 0.0f;
    atomic_fetch_add(&d->commands, 1);
}

hrt_state hrt_drive_controller(const hrt_drive *d) { return (hrt_state)d->command[d->command_read].state; }

/* ---------------------------------------------------------------------------------------------- the tick's thread */

/* Returns the distance from the handle's point to the tip: 0 without torque at the handle, as only torque lets the hand
 * feel a tip that its rotation moves. */
static double arm_of(const hrt_controller *c) {
    const bool renders = c->axes.is_free && c->params.device->tilts && c->params.handle_torque_max_Nm > 0.0f;
    return renders ? (double)c->params.arm_m : 0.0;
}

/* Adds to the tip what the tilt of the handle moves it; upright it is at the cursor. */
static void swing_tip(double arm_m, const double tilt_rad[2], double tip_m[3]) {
    const double angle = hypot(tilt_rad[0], tilt_rad[1]);
    for (int i = 0; i < 2 && angle > 0.0; i++) tip_m[i] += arm_m * sin(angle) * tilt_rad[i] / angle;
    tip_m[2] += arm_m * (cos(angle) - 1.0);
}

static void take_joints(hrt_drive *d, const hrt_controller *c, const hrt_drive_state *s, hrt_input *in) {
    const hrt_device_type *type = c->params.device;
    double joint[HRT_JOINTS] = {0};
    const bool own = has_joints(d);
    for (int i = 0; i < type->motors; i++) joint[i] = own ? s->cursor_m[i] : d->workspace.tip_m[i];
    if (!own && arm_of(c) > 0.0) swing_tip(arm_of(c), d->workspace.tilt_rad, joint);
    if (type->roll >= 0 && !own) joint[type->roll] = d->workspace.roll_rad;
    if (type->grip >= 0 && !own) joint[type->grip] = d->workspace.grip_now;
    for (int i = 0; i < 2 && type->tilts && !own; i++) joint[HRT_TILT + i] = d->workspace.tilt_rad[i];
    for (int j = 0; j < type->joints; j++) {
        const double count = joint[j] * (double)c->params.counts_per_unit[j] + (double)c->params.count_zero[j];
        in->count[j] = (int32_t)lrint(fmin(fmax(count, -2.0e9), 2.0e9));
    }
    in->encoder_us = s->time_us;
}

void hrt_drive_take(hrt_drive *d, int64_t now_us, const hrt_controller *c, hrt_input *in) {
    const bool up = atomic_load(&d->up);
    in->bus_ok = true;
    in->device_watchdog = !up;
    in->device_fault = (uint8_t)atomic_load(&d->fault);
    if (up) in->device_session = atomic_load(&d->session);
    if (atomic_load(&d->state_between) & UNREAD) d->state_read = atomic_exchange(&d->state_between, d->state_read) & 3u;
    const hrt_drive_state *s = &d->state[d->state_read];
    if (s->time_us == 0) return;
    hrt_workspace *w = &d->workspace;
    const bool pressed = w->clutch >= 0 && s->button[w->clutch];
    const bool force_on = c->state == HRT_ENGAGED || c->state == HRT_STALE;
    const double dt_s = 1.0e-6 * (double)(now_us - d->taken_us);
    d->taken_us = now_us;
    const bool tilts = c->params.device->tilts;
    if (!tilts && (s->orientation[2] != 0.0 || s->orientation[3] != 0.0)) hrt_workspace_roll(w, s->orientation);
    hrt_workspace_grip(w, s->trigger >= 0.0 ? s->trigger : w->grip >= 0 && s->button[w->grip] ? 1.0 : 0.0, dt_s);
    if (!has_joints(d) && !hrt_workspace_follow(w, s->cursor_m, pressed, force_on)) in->enable = false;
    if (tilts && !has_joints(d)) hrt_workspace_orient(w, s->orientation, arm_of(c), dt_s);
    if (s->withheld || (arm_of(c) > 0.0 && w->lags)) in->enable = false; /* a torque needs the tip that it belongs to */
    in->pedal = w->grip >= 0 && s->button[w->grip];
    take_joints(d, c, s, in);
}

void hrt_drive_give(hrt_drive *d, int64_t now_us, const hrt_result *result, bool reset) {
    hrt_drive_command *c = &d->command[d->command_write];
    c->time_us = now_us;
    c->state = (uint8_t)result->state;
    memset(c->torque_Nm, 0, sizeof c->torque_Nm);
    if (result->motors_on && !has_joints(d))
        hrt_workspace_torque(&d->workspace, result->handle_torque_Nm, c->torque_Nm);
    if (result->motors_on && has_joints(d))
        memcpy(c->force_N, result->torque, sizeof c->force_N);
    else if (result->motors_on)
        hrt_workspace_force(&d->workspace, result->torque, c->force_N);
    else
        memset(c->force_N, 0, sizeof c->force_N);
    d->command_write = atomic_exchange(&d->command_between, d->command_write | UNREAD) & 3u;
    if (reset) atomic_store(&d->fault, HRT_DRIVE_FINE);
}
