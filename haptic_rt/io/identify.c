#include "identify.h"

#include <math.h>
#include <string.h>

enum { N = HRT_IDENTIFY_UNKNOWNS };
static const double PI = 3.14159265358979323846, FADE_S = 0.2, SETTLE_S = 0.3, SLIDES_M_S = 0.001, MIN_M_S = 0.005,
                    CORNER_HZ = 20.0, AMPLITUDE_N = 0.3;

double hrt_identify_signal(double time_s, double duration_s) {
    static const double hertz[] = {2.0, 5.0, 9.0, 16.0};
    enum { SINES = sizeof hertz / sizeof *hertz };
    double sum = 0.0;
    for (int k = 0; k < SINES; k++) /* Schroeder's phases keep the peak low */
        sum += sin(2.0 * PI * hertz[k] * time_s - PI * k * k / SINES);
    const double fade = fmin(fmin(time_s, duration_s - time_s) / FADE_S, 1.0);
    return AMPLITUDE_N * fmax(fade, 0.0) * sum;
}

/* Filters by a second-order low-pass; out: filtered value, its first and second derivative by the bilinear rule. */
static void filter(double state[2], double in, double tick_s, double out[3]) {
    const double omega = 2.0 * PI * CORNER_HZ, g = 0.5 * omega * tick_s, damping = 1.4;
    const double high = (in - (damping + g) * state[0] - state[1]) / (1.0 + damping * g + g * g);
    const double band = g * high + state[0], low = g * band + state[1];
    state[0] = g * high + band;
    state[1] = g * band + low;
    out[0] = low;
    out[1] = omega * band;
    out[2] = omega * omega * high;
}

void hrt_identify_take(hrt_identify *d, double force_N, double position_m, double tick_s) {
    double force[3], position[3];
    if (d->ticks == 0) d->origin_m = position_m;
    filter(d->force_state, force_N, tick_s, force);
    filter(d->position_state, position_m - d->origin_m, tick_s, position);
    d->tick_s = tick_s;
    memcpy(d->force[d->ticks % HRT_IDENTIFY_LAGS], force, sizeof d->force[0]);
    if ((double)d->ticks++ * tick_s < SETTLE_S) return;
    if (fabs(position[1]) < MIN_M_S) return; /* it may stick, and friction is then no function of the velocity */
    d->taken++;
    const double sign = position[1] / (fabs(position[1]) + SLIDES_M_S);
    for (int64_t n = 0; n < HRT_IDENTIFY_LAGS; n++) {
        const double *past = d->force[(d->ticks - 1 + HRT_IDENTIFY_LAGS - n) % HRT_IDENTIFY_LAGS];
        const double row[N] = {position[2], position[1], sign, position[0], past[1], 1.0};
        for (int i = 0; i < N; i++) {
            for (int j = 0; j < N; j++) d->lag[n].matrix[i][j] += row[i] * row[j];
            d->lag[n].right[i] += row[i] * past[0];
        }
        d->lag[n].square += past[0] * past[0];
        d->lag[n].sum += past[0];
    }
}

/* Solves the scaled symmetric system by Gaussian elimination with pivoting. Returns false if it is singular. */
static bool solve(double a[N][N], double b[N]) {
    for (int k = 0; k < N; k++) {
        int best = k;
        for (int i = k + 1; i < N; i++)
            if (fabs(a[i][k]) > fabs(a[best][k])) best = i;
        if (!(fabs(a[best][k]) > 1.0e-9)) return false;
        for (int j = 0; j < N; j++) {
            const double kept = a[k][j];
            a[k][j] = a[best][j];
            a[best][j] = kept;
        }
        const double kept = b[k];
        b[k] = b[best];
        b[best] = kept;
        for (int i = k + 1; i < N; i++) {
            const double share = a[i][k] / a[k][k];
            for (int j = k; j < N; j++) a[i][j] -= share * a[k][j];
            b[i] -= share * b[k];
        }
    }
    for (int k = N - 1; k >= 0; k--) {
        for (int j = k + 1; j < N; j++) b[k] -= a[k][j] * b[j];
        b[k] /= a[k][k];
    }
    return true;
}

static bool solve_lag(const hrt_identify *d, int n, hrt_identified *found) {
    double a[N][N], b[N], scale[N], explained = 0.0;
    for (int i = 0; i < N; i++) {
        if (!(d->lag[n].matrix[i][i] > 0.0)) return false;
        scale[i] = 1.0 / sqrt(d->lag[n].matrix[i][i]);
    }
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) a[i][j] = scale[i] * scale[j] * d->lag[n].matrix[i][j];
        b[i] = scale[i] * d->lag[n].right[i];
    }
    if (!solve(a, b)) return false;
    for (int i = 0; i < N; i++) explained += b[i] * scale[i] * d->lag[n].right[i];
    const double variance = d->lag[n].square - d->lag[n].sum * d->lag[n].sum / (double)d->taken;
    *found = (hrt_identified){.mass_kg = scale[0] * b[0],
                              .damping_N_s_m = scale[1] * b[1],
                              .friction_N = scale[2] * b[2],
                              .stiffness_N_m = scale[3] * b[3],
                              .delay_s = scale[4] * b[4] + n * d->tick_s,
                              .residual = variance > 0.0 ? fmax(d->lag[n].square - explained, 0.0) / variance : 1.0};
    return true;
}

/* Takes the whole delay that leaves the least to the derivative of the force: its series is short then. A long delay
 * can imitate a mass below zero; such solutions are left out. */
bool hrt_identify_solve(const hrt_identify *d, hrt_identified *found) {
    double least = INFINITY;
    for (int n = 0; n < HRT_IDENTIFY_LAGS; n++) {
        hrt_identified one;
        if (!solve_lag(d, n, &one) || !(one.mass_kg > 0 && one.damping_N_s_m >= 0 && one.stiffness_N_m >= 0)) continue;
        if (fabs(one.delay_s - n * d->tick_s) >= least) continue;
        least = fabs(one.delay_s - n * d->tick_s);
        *found = one;
    }
    return least < INFINITY;
}
