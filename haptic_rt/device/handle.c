#include "handle.h"

#include <math.h>

#include "libtensormass/numeric/elementary.h"

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double a[3], const double b[3], double c[3]) {
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        c[i] = a[j] * b[k] - a[k] * b[j];
    }
}

static void direct(const hrt_handle *h, const double tilt_rad[2], double direction[3]) {
    const double joint[HRT_JOINTS] = {[HRT_TILT] = tilt_rad[0], [HRT_TILT + 1] = tilt_rad[1]};
    hrt_direction64(&h->axes, joint, direction);
}

/* Computes the shortest rotation from a to b, as a vector of its angle. */
static void turn_between(const double a[3], const double b[3], double angle[3]) {
    cross(a, b, angle);
    const double sine = sqrt(dot(angle, angle));
    const double share = sine > 0.0 ? tm_arctangent2(sine, dot(a, b)) / sine : 0.0;
    for (int i = 0; i < 3; i++) angle[i] *= share;
}

/* Removes the part along the direction: the shaft does not turn about itself here. */
static void put_across(const double direction[3], double a[3]) {
    const double along = dot(direction, a);
    for (int i = 0; i < 3; i++) a[i] -= along * direction[i];
}

/* Moves the direction by the turn that its rate makes in dt_s. */
static void advance(hrt_handle *h, double dt_s) {
    const double rate = sqrt(dot(h->turn_rad_s, h->turn_rad_s));
    double across[3], sine, cosine, size2 = 0.0;
    if (!(rate > 0.0)) return;
    cross(h->turn_rad_s, h->direction, across);
    tm_sine_cosine(rate * dt_s, &sine, &cosine);
    for (int i = 0; i < 3; i++) {
        h->direction[i] = cosine * h->direction[i] + sine * (across[i] / rate);
        size2 += h->direction[i] * h->direction[i];
    }
    for (int i = 0; i < 3; i++) h->direction[i] /= sqrt(size2);
    put_across(h->direction, h->turn_rad_s);
}

void hrt_handle_init(hrt_handle *h, const hrt_device_type *device, const double tilt_rad[2]) {
    *h = (hrt_handle){.axes = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .device = device, .twin = hrt_twin_of(device)}};
    direct(h, tilt_rad, h->direction);
}

/* Updates the rate. Viscous damping is implicit; dry friction is limited to what stops the handle within the step. */
static void accelerate(hrt_handle *h, const hrt_turning *c, const double push_Nm[3], double dt_s) {
    const double damping = 1.0 + dt_s * (c->hand_damping_Nm_s + c->viscous_Nm_s) / c->inertia_kg_m2;
    for (int i = 0; i < 3; i++) h->turn_rad_s[i] = (h->turn_rad_s[i] + dt_s * push_Nm[i] / c->inertia_kg_m2) / damping;
    put_across(h->direction, h->turn_rad_s);
    const double rate = sqrt(dot(h->turn_rad_s, h->turn_rad_s)), lost = dt_s * c->coulomb_Nm / c->inertia_kg_m2;
    for (int i = 0; i < 3; i++) h->turn_rad_s[i] = rate > lost ? h->turn_rad_s[i] * (1.0 - lost / rate) : 0.0;
}

void hrt_handle_turn(hrt_handle *h, const hrt_turning *c, const double torque_Nm[3], const double was_rad[2],
                     const double wanted_rad[2], double most_rad, double dt_s, double tilt_rad[2]) {
    double was[3], wanted[3], away[3], moved[3], push_Nm[3];
    direct(h, was_rad, was);
    direct(h, wanted_rad, wanted);
    turn_between(h->direction, wanted, away);
    turn_between(was, wanted, moved);
    for (int i = 0; i < 3; i++)
        push_Nm[i] = torque_Nm[i] + c->hand_stiffness_Nm * away[i] + c->hand_damping_Nm_s * (moved[i] / dt_s);
    accelerate(h, c, push_Nm, dt_s);
    advance(h, dt_s);
    hrt_tilt64(&h->axes, h->direction, tilt_rad);
    const double tilt = sqrt(tilt_rad[0] * tilt_rad[0] + tilt_rad[1] * tilt_rad[1]);
    if (tilt <= most_rad) return;
    for (int i = 0; i < 2; i++) tilt_rad[i] *= most_rad / tilt; /* the stop */
    hrt_handle_init(h, h->axes.device, tilt_rad);
}

void hrt_handle_swing(const hrt_handle *h, const double tilt_rad[2], double arm_m, double swing_m[3]) {
    double direction[3];
    direct(h, tilt_rad, direction);
    for (int i = 0; i < 3; i++) swing_m[i] = arm_m * (direction[i] - (i == 2 ? 1.0 : 0.0));
}
