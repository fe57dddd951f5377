#include "workspace.h"

#include <math.h>
#include <string.h>

static const double ROLL_MAX_RAD = 9.9, GRIP_PER_S = 8.0, PI = 3.14159265358979323846;
static const double TILT_MAX_RAD = 2.5, TURN_RAD_S = 60.0, SWING_M_S = 2.0;

hrt_workspace hrt_workspace_default(void) {
    return (hrt_workspace){.scale = 1.0, .depth_m = 0.1, .clutch = 0, .grip = 1};
}

/* Turns user axes into joint axes and back: half a turn about y. */
static void turn(const double a[3], double b[3]) {
    b[0] = -a[0];
    b[1] = a[1];
    b[2] = -a[2];
}

/* Sets the offset so that the cursor is mapped to `tip_m`. */
static void place(hrt_workspace *w, const double turned[3], const double tip_m[3]) {
    for (int i = 0; i < 3; i++) w->offset_m[i] = tip_m[i] - w->scale * turned[i];
}

bool hrt_workspace_follow(hrt_workspace *w, const double cursor_m[3], bool pressed, bool force_on) {
    double turned[3];
    turn(cursor_m, turned);
    if (!w->placed) {
        const double first[3] = {0.0, 0.0, w->depth_m};
        place(w, turned, first);
        w->placed = true;
    }
    if (!pressed) {
        if (w->state == HRT_CLUTCH_HELD) place(w, turned, w->tip_m);
        w->state = HRT_CLUTCH_FOLLOWS;
    } else if (w->state != HRT_CLUTCH_HELD)
        w->state = force_on ? HRT_CLUTCH_FADES : HRT_CLUTCH_HELD;
    if (w->state != HRT_CLUTCH_HELD)
        for (int i = 0; i < 3; i++) w->tip_m[i] = w->offset_m[i] + w->scale * turned[i];
    return !pressed;
}

void hrt_workspace_force(const hrt_workspace *w, const float tip_N[3], float cursor_N[3]) {
    const double share = fmin(w->scale, 1.0),
                 tip[3] = {share * (double)tip_N[0], share * (double)tip_N[1], share * (double)tip_N[2]};
    double back[3];
    turn(tip, back);
    for (int i = 0; i < 3; i++) cursor_N[i] = (float)back[i];
}

void hrt_workspace_torque(const hrt_workspace *w, const float tip_Nm[3], float cursor_Nm[3]) {
    const double share = fmin(1.0 / w->scale, 1.0),
                 tip[3] = {share * (double)tip_Nm[0], share * (double)tip_Nm[1], share * (double)tip_Nm[2]};
    double back[3];
    turn(tip, back);
    for (int i = 0; i < 3; i++) cursor_Nm[i] = (float)back[i];
}

void hrt_workspace_roll(hrt_workspace *w, const double q[4]) {
    const double now = 2.0 * atan2(q[2], q[3]);
    if (w->roll_known) w->roll_rad += remainder(now - w->roll_last_rad, 2.0 * PI);
    w->roll_rad = fmin(fmax(w->roll_rad, -ROLL_MAX_RAD), ROLL_MAX_RAD);
    w->roll_last_rad = now;
    w->roll_known = true;
}

static void multiply(const double a[4], const double b[4], double c[4]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        c[i] = a[3] * b[i] + b[3] * a[i] + a[j] * b[k] - a[k] * b[j];
    }
    c[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

/* Computes the tilt of the tool's -z, as a rotation of the tip's z axis. Returns false if it had to be reduced. */
static bool find_tilt(const double q[4], double tilt_rad[2]) {
    const double down[3] = {-2.0 * (q[0] * q[2] + q[3] * q[1]), -2.0 * (q[1] * q[2] - q[3] * q[0]),
                            -(1.0 - 2.0 * (q[0] * q[0] + q[1] * q[1]))};
    double d[3];
    turn(down, d);
    const double across = hypot(d[0], d[1]), full = atan2(across, d[2]), angle = fmin(full, TILT_MAX_RAD);
    for (int i = 0; i < 2; i++) tilt_rad[i] = across > 0.0 ? angle * d[i] / across : 0.0;
    return full <= TILT_MAX_RAD;
}

/* Moves tilt and roll towards those of the tool, by `most` radians. */
static void approach(hrt_workspace *w, const double tilt_rad[2], double most) {
    const double away = hypot(tilt_rad[0] - w->tilt_rad[0], tilt_rad[1] - w->tilt_rad[1]), roll_rad = w->roll_rad;
    if (away > most) w->lags = true;
    for (int i = 0; i < 2; i++) w->tilt_rad[i] += (tilt_rad[i] - w->tilt_rad[i]) * (away <= most ? 1.0 : most / away);
    w->roll_rad = w->roll_wanted_rad;
    hrt_workspace_roll(w, w->tool);
    w->roll_wanted_rad = w->roll_rad;
    w->roll_rad = roll_rad + fmin(fmax(w->roll_wanted_rad - roll_rad, -most), most);
}

void hrt_workspace_orient(hrt_workspace *w, const double orientation[4], double arm_m, double dt_s) {
    double q[4], tilt_rad[2], size2 = 0.0;
    const double turn_rad_s = arm_m * TURN_RAD_S > SWING_M_S ? SWING_M_S / arm_m : TURN_RAD_S;
    for (int i = 0; i < 4; i++) size2 += orientation[i] * orientation[i];
    if (!(size2 > 0.25)) return; /* unknown */
    const bool first = !w->oriented;
    for (int i = 0; i < 4; i++) q[i] = orientation[i] / sqrt(size2);
    if (first)
        for (int i = 0; i < 4; i++) w->offset[i] = i == 3 ? 1.0 : 0.0;
    w->oriented = true;
    if (w->state == HRT_CLUTCH_HELD && !first) {
        w->turned_away = true;
        return;
    }
    if (w->turned_away) {
        const double back[4] = {-q[0], -q[1], -q[2], q[3]};
        multiply(back, w->tool, w->offset);
    }
    w->turned_away = false;
    multiply(q, w->offset, w->tool);
    w->lags = !find_tilt(w->tool, tilt_rad);
    approach(w, tilt_rad, first ? INFINITY : turn_rad_s * fmin(fmax(dt_s, 0.0), 0.05));
}

void hrt_workspace_grip(hrt_workspace *w, double wanted, double dt_s) {
    const double step = GRIP_PER_S * fmin(fmax(dt_s, 0.0), 0.05);
    w->grip_now += fmin(fmax(fmin(fmax(wanted, 0.0), 1.0) - w->grip_now, -step), step);
}
