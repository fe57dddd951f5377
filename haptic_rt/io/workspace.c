#include "workspace.h"

#include <math.h>
#include <string.h>

static const double ROLL_MAX_RAD = 9.9, GRIP_PER_S = 8.0, PI = 3.14159265358979323846;

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

void hrt_workspace_roll(hrt_workspace *w, const double q[4]) {
    const double now = 2.0 * atan2(q[2], q[3]);
    if (w->roll_known) w->roll_rad += remainder(now - w->roll_last_rad, 2.0 * PI);
    w->roll_rad = fmin(fmax(w->roll_rad, -ROLL_MAX_RAD), ROLL_MAX_RAD);
    w->roll_last_rad = now;
    w->roll_known = true;
}

void hrt_workspace_grip(hrt_workspace *w, double wanted, double dt_s) {
    const double step = GRIP_PER_S * fmin(fmax(dt_s, 0.0), 0.05);
    w->grip_now += fmin(fmax(fmin(fmax(wanted, 0.0), 1.0) - w->grip_now, -step), step);
}
