#include "controls.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"
static const double PACE_M_S = 0.03, ROLL_RAD_S = 1.5, GRIP_1_S = 4, WHEEL_M = 0.003, SLOW = 0.25;
static const float TURN_RAD_PX = 0.006f;

void play_controls_begin(play_controls *c) {
    memset(c, 0, sizeof *c);
    c->help = true;
    c->eye_zoom = 1;
}

static bool axes_of(const view_instrument *t, hrt_axes *axes) {
    const float axis[3] = {(float)t->axis[0], (float)t->axis[1], (float)t->axis[2]},
                up[3] = {(float)t->up[0], (float)t->up[1], (float)t->up[2]};
    return t->device && hrt_axes_along(axes, t->device, axis, up);
}

/* Returns the joint, or null if the device has none of this role. */
static double *joint_of(play_hand *hand, int32_t role) { return role < 0 ? NULL : &hand->joint[role]; }

/* Initialises the hand at the instrument's pose, so that nothing jumps; again if the device changes. */
static void meet(play_hand *hand, const view_instrument *t) {
    hrt_axes axes;
    float tip[3], joint[3];
    hand->known = hand->known && hand->params.device == t->device;
    if (hand->known || !t->shown || !axes_of(t, &axes)) return;
    for (int k = 0; k < 3; k++) tip[k] = (float)(t->tip_m[k] - t->trocar_m[k]);
    if (!hrt_inverse(&axes, tip, joint)) return;
    hrt_params_of_device(&hand->params, t->device);
    memset(hand->joint, 0, sizeof hand->joint);
    for (int k = 0; k < t->device->motors; k++) hand->joint[k] = (double)joint[k];
    double *roll = joint_of(hand, t->device->roll), *grip = joint_of(hand, t->device->grip);
    if (roll) *roll = t->roll_rad;
    if (grip) *grip = t->grip;
    hand->known = true;
}

/* Returns the command that is sent with the next picture; all keys since the last picture share it. */
static view_command *command_for(play_controls *c) {
    if (!c->has_command || c->command.instrument != c->selected)
        c->command = (view_command){.instrument = c->selected, .extrapolator = "", .passivity = -1};
    c->has_command = true;
    return &c->command;
}

static void next_extrapolator(play_controls *c, const view_instrument *t) {
    hrt_extrapolator now = HRT_HOLD;
    if (!hrt_extrapolator_find(t->extrapolator, &now)) now = (hrt_extrapolator)-1;
    hrt_extrapolator next = (hrt_extrapolator)(((int)now + 1) % HRT_EXTRAPOLATOR_COUNT);
    if (next == HRT_PAPER_POSITION) next = (hrt_extrapolator)(((int)next + 1) % HRT_EXTRAPOLATOR_COUNT);
    snprintf(c->extrapolator, sizeof c->extrapolator, "%s", hrt_extrapolator_name(next));
    command_for(c)->extrapolator = c->extrapolator;
}

static void select_next(play_controls *c, const view_picture *p, int wanted) {
    if (wanted >= 0 && wanted < VIEW_INSTRUMENTS && p->instrument[wanted].shown) {
        c->hand[c->selected].acting = false;
        c->selected = wanted;
    }
}

static void key_down(play_controls *c, const view_picture *p, int code) {
    const view_instrument *t = &p->instrument[c->selected];
    switch (code) {
    case PLAY_ESCAPE: c->quit = true; break;
    case PLAY_TAB: select_next(c, p, (c->selected + 1) % VIEW_INSTRUMENTS); break;
    case '1': select_next(c, p, 0); break;
    case '2': select_next(c, p, 1); break;
    case 'f': c->hand[c->selected].latched = !c->hand[c->selected].latched; break;
    case 'h': c->help = !c->help; break;
    case 'x': next_extrapolator(c, t); break;
    case 'p': command_for(c)->passivity = !t->passivity; break;
    case 'r': command_for(c)->reset_fault = true; break;
    default: break;
    }
}

static void update_acting(play_controls *c) { c->hand[c->selected].acting = c->held[' '] || c->button[3]; }

void play_controls_event(play_controls *c, const view_picture *p, const play_event *e) {
    switch (e->type) {
    case PLAY_QUIT: c->quit = true; break;
    case PLAY_KEY:
        if (e->code > 0 && e->code < 512) c->held[e->code] = e->down;
        if (e->down) key_down(c, p, e->code);
        break;
    case PLAY_BUTTON:
        if (e->code >= 1 && e->code <= 3) c->button[e->code] = e->down;
        break;
    case PLAY_MOTION:
        if (c->button[1]) c->motion[0] += e->dx, c->motion[1] += e->dy;
        if (c->button[2]) c->eye_turn[0] -= TURN_RAD_PX * e->dx, c->eye_turn[1] += TURN_RAD_PX * e->dy;
        break;
    case PLAY_WHEEL:
        if (c->held['z'])
            c->eye_zoom *= powf(1.1f, e->dy);
        else
            c->wheel += e->dy;
        break;
    case PLAY_FOCUS_LOST: /* the release of a key in another window is not reported */
        memset(c->held, 0, sizeof c->held);
        memset(c->button, 0, sizeof c->button);
        break;
    }
    update_acting(c);
}

/* Computes the eye's right and up directions in the world. */
static void eye_axes(const view_camera *camera, int height_px, float right[3], float up[3]) {
    float view[16], projection[16];
    view_camera_matrices(camera, height_px, height_px, view, projection);
    for (int k = 0; k < 3; k++) right[k] = view[4 * k], up[k] = view[4 * k + 1];
}

/* Returns the metres per pixel at the depth of a point. */
static double metres_a_pixel(const view_camera *camera, int height_px, const double point_m[3]) {
    double to[3], at[3], depth = 0, length = 0;
    for (int k = 0; k < 3; k++) {
        to[k] = (double)camera->at_m[k] - (double)camera->eye_m[k];
        at[k] = point_m[k] - (double)camera->eye_m[k];
        depth += to[k] * at[k], length += to[k] * to[k];
    }
    depth = fmax(depth / sqrt(fmax(length, 1e-12)), 1e-3);
    return 2 * depth * tan((double)camera->fov_rad / 2) / height_px;
}

/* Moves the tip to a position as far as the device can; `keep` leaves a shaft's insertion unchanged. */
static void put_tip(play_hand *hand, const hrt_axes *axes, const float tip_m[3], bool keep) {
    const int32_t insertion = axes->device->insertion;
    float joint[3];
    if (!hrt_inverse(axes, tip_m, joint)) return;
    for (int j = 0; j < axes->device->motors; j++)
        if (!keep || j != insertion) hand->joint[j] = (double)joint[j];
}

/* Rotates the instrument about its trocar so that the tip moves by `across` and `upward` (m) in the picture. The motion
 * is perpendicular to the shaft, and damped where the eye sees that plane edge-on. */
static void pivot(play_hand *hand, const view_instrument *t, const float right[3], const float up[3], float across,
                  float upward) {
    static const float DAMPING = 0.06f;
    hrt_axes axes;
    float joint[HRT_JOINTS], tip[3], to[3], u[3], v[3];
    if (!axes_of(t, &axes)) return;
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = (float)hand->joint[j];
    hrt_tip(&axes, joint, tip);
    view_frame(tip, u, v);
    float a = vdot(u, right), b = vdot(v, right), c = vdot(u, up), d = vdot(v, up);
    float m00 = a * a + c * c + DAMPING, m01 = a * b + c * d, m11 = b * b + d * d + DAMPING,
          det = m00 * m11 - m01 * m01;
    float x = a * across + c * upward, y = b * across + d * upward;
    float along_u = (m11 * x - m01 * y) / det, along_v = (m00 * y - m01 * x) / det;
    for (int k = 0; k < 3; k++) to[k] = tip[k] + along_u * u[k] + along_v * v[k];
    put_tip(hand, &axes, to, true);
}

/* Inserts the shaft by this many metres. */
static void push_in(play_hand *hand, const view_instrument *t, double by_m) {
    hrt_axes axes;
    float joint[HRT_JOINTS], tip[3];
    double *insertion = joint_of(hand, t->device->insertion);
    if (insertion) *insertion += by_m;
    if (insertion || by_m == 0 || !axes_of(t, &axes)) return;
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = (float)hand->joint[j];
    hrt_tip(&axes, joint, tip);
    const float length = vnorm(tip);
    if (!(length > 1e-4f)) return;
    for (int k = 0; k < 3; k++) tip[k] *= 1 + (float)by_m / length;
    put_tip(hand, &axes, tip, false);
}

static double axis_of(const play_controls *c, int plus, int minus) {
    return (c->held[plus] ? 1 : 0) - (c->held[minus] ? 1 : 0);
}

static void keep_inside(play_hand *hand) {
    const hrt_params *limits = &hand->params;
    for (int j = 0; j < limits->device->joints; j++)
        hand->joint[j] = fmin(fmax(hand->joint[j], (double)limits->joint_min[j]), (double)limits->joint_max[j]);
}

void play_controls_step(play_controls *c, const view_picture *p, const view_camera *camera, int height_px,
                        double dt_s) {
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) meet(&c->hand[i], &p->instrument[i]);
    play_hand *hand = &c->hand[c->selected];
    const view_instrument *t = &p->instrument[c->selected];
    if (!hand->known) return;
    double pace = dt_s * (c->held[PLAY_SHIFT] ? SLOW : 1),
           px = metres_a_pixel(camera, height_px, t->tip_m) * (c->held[PLAY_SHIFT] ? SLOW : 1);
    float right[3], up[3];
    eye_axes(camera, height_px, right, up);
    double across = axis_of(c, PLAY_RIGHT, PLAY_LEFT) * PACE_M_S * pace + (double)c->motion[0] * px;
    double upward = axis_of(c, PLAY_UP, PLAY_DOWN) * PACE_M_S * pace - (double)c->motion[1] * px;
    if (across != 0 || upward != 0) pivot(hand, t, right, up, (float)across, (float)upward);
    push_in(hand, t,
            (axis_of(c, 'w', 's') + axis_of(c, PLAY_PAGE_DOWN, PLAY_PAGE_UP)) * PACE_M_S * pace +
                (double)c->wheel * WHEEL_M * (c->held[PLAY_SHIFT] ? SLOW : 1));
    double *roll = joint_of(hand, t->device->roll);
    if (roll) *roll += axis_of(c, 'e', 'q') * ROLL_RAD_S * pace;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) {
        if (!c->hand[i].known) continue;
        double *grip = joint_of(&c->hand[i], c->hand[i].params.device->grip);
        bool shut = p->instrument[i].mode == HRT_MODE_GRASPER && (c->hand[i].latched || c->hand[i].acting);
        if (grip) *grip += (shut ? 1 : -1) * GRIP_1_S * dt_s;
        keep_inside(&c->hand[i]);
    }
    c->motion[0] = c->motion[1] = c->wheel = 0;
}

bool play_controls_hand(const play_controls *c, const view_picture *p, int i, view_hand *hand) {
    if (!c->hand[i].known) return false;
    hand->instrument = i;
    hand->joints = c->hand[i].params.device->joints;
    memcpy(hand->joint, c->hand[i].joint, sizeof hand->joint);
    hand->active = p->instrument[i].mode == HRT_MODE_CAUTERY && c->hand[i].acting;
    return true;
}
