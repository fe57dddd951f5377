/* Time step. A block released from a sagged shape swings freely; its corner's trajectory, phase and energy are compared
 * for steps up to the critical one and beyond. Reference: a step 200 times below the largest, whose error (second
 * order) is 1/100 of that of the finest row. Settling: time until the damped block is at rest, which must not depend on
 * the step. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"

enum { CELLS = 3, MAX_SAMPLES = 1000, FINE = 200, STRIDE = 4 };
static const double PERIODS = 10;

typedef struct swing {
    double u[MAX_SAMPLES]; /* of the top corner along z, m, at equal times */
    double energy_drift;   /* largest |E - E_0| / E_0 of kinetic + elastic energy */
    double seconds_per_simulated;
    bool finite;
} swing;

/* Computes the equilibrium under gravity; without gravity it then swings mostly in the lowest mode. */
static tm_status sagged(double *u, double *period_s, tm_error *error) {
    problem p;
    problem_def def = problem_default(CELLS);
    def.pressed = false;
    tm_status status = problem_create(&def, &p, error);
    static const double g[3] = {0, 0, -9.81};
    if (status == TM_OK) status = tm_stage_gravity(p.world, g, error);
    if (status == TM_OK) status = problem_settle(&p, 1e-10, NULL, error);
    if (status == TM_OK) {
        memcpy(u, tm_world_state(p.world)->u_m, sizeof *u * 3 * (size_t)p.mesh->vertex_count);
        /* Rayleigh's quotient of the sagged shape: omega^2 = u.Ku / u.Mu. */
        double inertia = 0;
        for (int32_t i = 0; i < 3 * p.mesh->vertex_count; i++)
            inertia += tm_tissue_mass_kg(p.tissue)[i / 3] * u[i] * u[i];
        *period_s = 2 * M_PI / sqrt(2 * tm_tissue_energy(p.tissue, u) / inertia);
    }
    problem_destroy(&p);
    return status;
}

/* Sets u_prev such that the central velocity at the start is zero. */
static void start_from(problem *p, const double *u) {
    tm_state *s = tm_world_state(p->world);
    double dt = tm_world_step_s(p->world);
    const double *mass = tm_tissue_mass_kg(p->tissue);
    memcpy(s->u_m, u, sizeof *u * 3 * (size_t)p->mesh->vertex_count);
    tm_tissue_force(p->tissue, u, s->force_N);
    for (int32_t i = 0; i < 3 * p->mesh->vertex_count; i++)
        s->u_prev_m[i] = u[i] + 0.5 * dt * dt * s->force_N[i] / mass[i / 3];
    int n = p->cells;
    for (int32_t v = 0; v < p->mesh->vertex_count; v++) { /* the clamp and the symmetry planes remain */
        int i = v % (n + 1), j = v / (n + 1) % (n + 1), k = v / (n + 1) / (n + 1);
        for (int axis = 0; axis < 3; axis++)
            if (k == 0 || (axis == 0 && i == 0) || (axis == 1 && j == 0)) s->u_prev_m[3 * v + axis] = u[3 * v + axis];
    }
}

static double total_energy(problem *p, const double *u_before, const double *u) {
    const tm_state *s = tm_world_state(p->world);
    double kinetic = 0, dt = tm_world_step_s(p->world);
    for (int32_t i = 0; i < 3 * p->mesh->vertex_count; i++) {
        double v = (s->u_m[i] - u_before[i]) / (2 * dt);
        kinetic += 0.5 * tm_tissue_mass_kg(p->tissue)[i / 3] * v * v;
    }
    return kinetic + tm_tissue_energy(p->tissue, u);
}

/* Runs a swing with integer numbers of steps between samples, so that all trajectories are sampled at the same
 * times. */
static tm_status swing_run(double dt, int stride, int samples, const double *u, swing *out, tm_error *error) {
    problem p;
    problem_def def = problem_default(CELLS);
    def.pressed = false, def.dt_s = dt;
    tm_status status = problem_create(&def, &p, error);
    if (status != TM_OK) return status;
    start_from(&p, u);
    size_t n = 3 * (size_t)p.mesh->vertex_count;
    double *before = app_zeroed(n, sizeof *before), *now = app_zeroed(n, sizeof *now),
           first = tm_tissue_energy(p.tissue, u), spent = 0;
    int32_t corner = p.mesh->vertex_count - 1;
    *out = (swing){.finite = true};
    for (int s = 0; s < samples && status == TM_OK; s++) {
        double start = app_seconds();
        status = tm_world_step(p.world, stride - 1);
        spent += app_seconds() - start;
        memcpy(before, tm_world_state(p.world)->u_prev_m, n * sizeof *now);
        memcpy(now, tm_world_state(p.world)->u_m, n * sizeof *now);
        start = app_seconds();
        if (status == TM_OK) status = tm_world_step(p.world, 1);
        spent += app_seconds() - start;
        out->u[s] = tm_world_state(p.world)->u_m[3 * corner + 2];
        if (status == TM_OK)
            out->energy_drift = fmax(out->energy_drift, fabs(total_energy(&p, before, now) / first - 1));
    }
    out->seconds_per_simulated = spent / (samples * stride * dt);
    free(before);
    free(now);
    problem_destroy(&p);
    return status;
}

/* Returns the time shift of the last quarter relative to the reference over the elapsed time, by least squares in the
 * derivative. */
static double phase_error(const swing *s, const swing *truth, int samples, double sample_s) {
    double dot = 0, norm = 0;
    for (int i = samples * 3 / 4; i < samples - 1; i++) {
        double slope = (truth->u[i + 1] - truth->u[i - 1]) / (2 * sample_s);
        dot += slope * (s->u[i] - truth->u[i]), norm += slope * slope;
    }
    return fabs(dot / norm) / (sample_s * samples * 7 / 8);
}

/* Measures the simulated time until the corner of the damped, sagging block stays within 1 % of its equilibrium. */
static tm_status settling(double fraction, double *settle_s, tm_error *error) {
    problem p;
    problem_def def = problem_default(CELLS);
    def.pressed = false, def.material.damping_1_s = 30, def.step_fraction = fraction;
    tm_status status = problem_create(&def, &p, error);
    static const double g[3] = {0, 0, -9.81};
    if (status == TM_OK) status = tm_stage_gravity(p.world, g, error);
    double dt = status == TM_OK ? tm_world_step_s(p.world) : 1;
    int32_t corner = 3 * ((CELLS + 1) * (CELLS + 1) * (CELLS + 1) - 1) + 2, steps = (int32_t)(1.0 / dt);
    double *path = app_zeroed((size_t)steps, sizeof *path);
    for (int32_t i = 0; i < steps && status == TM_OK; i++) {
        status = tm_world_step(p.world, 1);
        path[i] = tm_world_state(p.world)->u_m[corner];
    }
    if (status == TM_OK) status = problem_settle(&p, 1e-10, NULL, error);
    if (status == TM_OK) {
        double rest = tm_world_state(p.world)->u_m[corner];
        int32_t last = steps;
        while (last > 0 && fabs(path[last - 1] / rest - 1) < 0.01) last--;
        *settle_s = last * dt;
    }
    free(path);
    problem_destroy(&p);
    return status;
}

tm_status knob_step(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    static const int divisor[] = {20, 10, 5, 2, 1};
    int count = (int)(sizeof divisor / sizeof *divisor);
    static swing truth, s;
    double u[3 * (CELLS + 1) * (CELLS + 1) * (CELLS + 1)], period = 1;
    tm_status status = sagged(u, &period, error);
    problem p = {0};
    problem_def def = problem_default(CELLS);
    def.pressed = false;
    double guaranteed = 0, estimate = 0;
    if (status == TM_OK) status = problem_create(&def, &p, error);
    if (status == TM_OK) {
        guaranteed = tm_critical_step_guaranteed(p.tissue, NULL);
        uint8_t *mask = app_zeroed(3, (size_t)p.mesh->vertex_count);
        tm_support_mask(p.world, mask);
        status = tm_critical_step_estimate(p.tissue, mask, 1e-6, 20000, &estimate, error);
        free(mask);
    }
    problem_destroy(&p);
    /* Samples are STRIDE of the largest steps apart, so every smaller step reaches the same times. */
    double largest = 0.98 * guaranteed, sample_s = STRIDE * largest;
    int samples = (int)fmin(PERIODS * period / sample_s, MAX_SAMPLES);
    if (status == TM_OK) status = swing_run(largest / FINE, STRIDE * FINE, samples, u, &truth, error);
    double amplitude = 0;
    for (int i = 0; i < samples; i++) amplitude = fmax(amplitude, fabs(truth.u[i]));
    for (int i = 0; i < count && status == TM_OK; i++) {
        double settle_s = 0, worst = 0;
        status = swing_run(largest / divisor[i], STRIDE * divisor[i], samples, u, &s, error);
        if (status == TM_OK) status = settling(largest / divisor[i] / guaranteed, &settle_s, error);
        for (int k = 0; k < samples; k++) worst = fmax(worst, fabs(s.u[k] - truth.u[k]));
        app_json_add(
            rows,
            "dt_s %g of_guaranteed %g of_sharp %g trajectory %g phase %g energy %g settle_s %g wall_per_simulated %g",
            largest / divisor[i], largest / divisor[i] / guaranteed, largest / divisor[i] / estimate, worst / amplitude,
            phase_error(&s, &truth, samples, sample_s), s.energy_drift, settle_s, s.seconds_per_simulated);
        r->progress("time step", (double)(i + 1) / count);
    }
    app_json_add(out, "guaranteed_s %g sharp_s %g period_s %g", guaranteed, estimate, period);
    return status;
}
