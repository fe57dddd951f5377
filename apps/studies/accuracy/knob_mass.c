/* Selective mass scaling. A cuttable block with displaced inner vertices, so that some tetrahedra are flat, is pressed
 * within 0.1 s and held. Compares the force on the indenter (felt by a hand) with that of the physical mass at its own
 * step. Measures the cost per simulated second as the step grows. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"
#include "bench.h"

enum { CELLS = 6, MAX_HELD = 6 * (CELLS + 1) * (CELLS + 1), FRAMES = 60, STEPS = 6 };
static const double PRESS_S = 0.1, ALL_S = 0.3, DEPTH_M = 0.0015, JITTER = 0.28;

typedef struct press {
    app_bench b;
    int32_t dof[MAX_HELD], held, pressed_from; /* components from here on follow the indenter */
    double force_N[FRAMES], per_step_s;
} press;

/* Displaces inner vertices, equally in every run; the surface stays in place. */
static void jitter(double *vertex_m, int32_t count, double by_m) {
    uint32_t state = 41;
    for (int32_t v = 0; v < count; v++) {
        const int32_t n = CELLS + 1, i = v % n, j = v / n % n, k = v / n / n;
        const bool inner = i > 0 && j > 0 && k > 0 && i < CELLS && j < CELLS && k < CELLS;
        for (int a = 0; a < 3 && inner; a++) {
            state = state * 1664525u + 1013904223u;
            vertex_m[3 * v + a] += by_m * ((double)(state >> 8) / (1 << 23) - 1);
        }
    }
}

static void hold(press *p) {
    const double *x = p->b.mesh->rest_m;
    for (int32_t v = 0; v < p->b.mesh->vertex_count; v++)
        for (int a = 0; a < 3 && x[3 * v + 2] < 1e-9; a++) p->dof[p->held++] = 3 * v + a;
    p->pressed_from = p->held;
    for (int32_t v = 0; v < p->b.mesh->vertex_count; v++)
        if (x[3 * v + 2] > BLOCK_M - 1e-9 && hypot(x[3 * v] - BLOCK_M / 2, x[3 * v + 1] - BLOCK_M / 2) < INDENTER_M / 2)
            p->dof[p->held++] = 3 * v + 2;
}

static tm_status press_make(press *p, double step_s, bool scaled, tm_error *error) {
    app_bench_def def = app_bench_default(CELLS, BLOCK_M);
    def.material[0] = material_liver(), def.material[0].damping_1_s = 20;
    def.cuttable = true, def.scaled_step_s = scaled ? step_s : 0, def.scaled_share = 100, def.dt_s = step_s;
    def.held = APP_HELD_NOT, def.deform = jitter, def.argument = JITTER * (BLOCK_M / CELLS);
    memset(p, 0, sizeof *p);
    const tm_status status = app_bench_open(&def, &p->b, error);
    if (status != TM_OK) return status;
    hold(p);
    static const double rest[MAX_HELD];
    tm_support_def support = tm_support_def_default();
    support.count = p->held, support.dof = p->dof, support.value_m = rest;
    return tm_stage_support(p->b.world, &support, error);
}

/* Runs a press. Forces are means over equal times, so that all steps are compared at the same moments. */
static tm_status press_run(press *p) {
    const double dt = tm_world_step_s(p->b.world);
    const int32_t n = 3 * p->b.mesh->vertex_count, steps = (int32_t)(ALL_S / dt);
    double *reaction = app_zeroed((size_t)n, sizeof *reaction), spent = 0;
    int32_t count[FRAMES] = {0};
    tm_status status = TM_OK;
    for (int32_t i = 0; i < steps && status == TM_OK; i++) {
        const double s = fmin(1, (i + 1) * dt / PRESS_S), way = -DEPTH_M * s * s * (3 - 2 * s), start = app_seconds();
        for (int32_t c = p->pressed_from; c < p->held; c++) tm_support_move(p->b.world, c, way);
        status = tm_world_step(p->b.world, 1);
        spent += app_seconds() - start;
        memset(reaction, 0, sizeof *reaction * (size_t)n);
        tm_support_reaction(p->b.world, reaction);
        const int frame = (int)((i + 0.5) * dt / ALL_S * FRAMES);
        count[frame]++;
        for (int32_t c = p->pressed_from; c < p->held; c++) p->force_N[frame] += reaction[p->dof[c]];
    }
    for (int f = 0; f < FRAMES; f++)
        if (count[f]) p->force_N[f] /= count[f];
    p->per_step_s = spent / steps;
    free(reaction);
    return status;
}

static void distance(const press *p, const press *truth, double *rms, double *held) {
    double sum = 0, all = 0;
    for (int f = 0; f < FRAMES; f++) {
        sum += pow(p->force_N[f] - truth->force_N[f], 2);
        all += pow(truth->force_N[f], 2);
    }
    *rms = sqrt(sum / all);
    *held = fabs(p->force_N[FRAMES - 1] / truth->force_N[FRAMES - 1] - 1);
}

static tm_status row_of(cJSON *rows, press *p, const press *truth, double own_s, bool scaled, tm_error *error) {
    double rms, held, own_Hz[3], Hz[3];
    tm_mass_scaling m;
    uint8_t *fixed = app_zeroed(3, (size_t)p->b.mesh->vertex_count);
    for (int32_t i = 0; i < p->pressed_from; i++) fixed[p->dof[i]] = 1;
    const tm_status status = tm_mass_scaling_frequencies(p->b.tissue, fixed, own_Hz, Hz, error);
    free(fixed);
    if (status != TM_OK) return status;
    tm_tissue_mass_scaling(p->b.tissue, &m);
    distance(p, truth, &rms, &held);
    app_json_add(
        rows,
        "scaled %hhd dt_s %g of_own %g added %g vertices %d frequency %g force %g held_force %g wall_per_simulated %g",
        scaled, tm_world_step_s(p->b.world), tm_world_step_s(p->b.world) / own_s, m.added_kg / m.physical_kg,
        m.vertices, Hz[2] / own_Hz[2], rms, held, p->per_step_s / tm_world_step_s(p->b.world));
    return TM_OK;
}

tm_status knob_mass(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    static const double times[STEPS] = {0.9, 2, 3, 3.25, 3.5, 4};
    press truth, p;
    tm_status status = press_make(&truth, 0, false, error);
    const double own_s = status == TM_OK ? tm_critical_step_guaranteed(truth.b.tissue, NULL) : 0;
    app_bench_close(&truth.b);
    if (status == TM_OK) status = press_make(&truth, own_s / 10, false, error);
    if (status == TM_OK) status = press_run(&truth);
    for (int i = 0; i < STEPS && status == TM_OK; i++) {
        status = press_make(&p, times[i] * own_s, times[i] > 1, error);
        if (status == TM_OK) status = press_run(&p);
        if (status == TM_OK) status = row_of(rows, &p, &truth, own_s, times[i] > 1, error);
        app_bench_close(&p.b);
        r->progress("mass scaling", (double)(i + 1) / STEPS);
    }
    app_bench_close(&truth.b);
    app_json_add(out, "own_s %g", own_s);
    return status;
}
