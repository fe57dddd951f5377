/* Identification of a device with the hand that holds it, along one axis: mass, damping, friction and stiffness, and
 * the delay between a command and the force, by least squares over
 *   m a + b v + c sign(v) + k x + x0 = F - delay F'
 * for each delay by whole ticks; the one counts that leaves least to the derivative. Force and position pass the same
 * filter, whose states are the derivatives, so that counts are not differentiated. */
#ifndef HRT_IDENTIFY_H
#define HRT_IDENTIFY_H

#include <stdbool.h>
#include <stdint.h>

enum { HRT_IDENTIFY_UNKNOWNS = 6, HRT_IDENTIFY_LAGS = 10 };

typedef struct hrt_identify {
    double force_state[2], position_state[2], origin_m;
    double force[HRT_IDENTIFY_LAGS][2]; /* the last ones and their derivatives, by tick */
    struct {
        double matrix[HRT_IDENTIFY_UNKNOWNS][HRT_IDENTIFY_UNKNOWNS], right[HRT_IDENTIFY_UNKNOWNS];
        double square, sum; /* of the force */
    } lag[HRT_IDENTIFY_LAGS];
    int64_t ticks, taken;
    double tick_s;
} hrt_identify;

typedef struct hrt_identified {
    double mass_kg, damping_N_s_m, friction_N, stiffness_N_m, delay_s;
    double residual; /* share of the force's variance that the model leaves unexplained */
} hrt_identified;

/* Returns the force of the test signal at a time, N: four sines of 2 to 16 Hz, which fade in and out; at most 1.2 N. */
double hrt_identify_signal(double time_s, double duration_s);
/* Takes a tick: the rendered force and the position along the axis. */
void hrt_identify_take(hrt_identify *identify, double force_N, double position_m, double tick_s);
/* Solves. Returns false if the motion does not determine the unknowns. */
bool hrt_identify_solve(const hrt_identify *identify, hrt_identified *found);

#endif
