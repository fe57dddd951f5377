/* The pressed quarter block: mesh, supports, equilibrium, measured quantities, and CalculiX's results. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"
#include "bench.h"

/* --- references --- */

static const cJSON *cases(const cJSON *truth, const char *name) {
    return cJSON_GetObjectItem(cJSON_GetObjectItem(truth, name), "cases");
}

int reference_cases(const cJSON *truth, const char *name) { return cJSON_GetArraySize(cases(truth, name)); }

bool reference_case(const cJSON *truth, const char *name, int index, double *depth, measured *m) {
    const cJSON *one = cJSON_GetArrayItem(cases(truth, name), index), *u = cJSON_GetObjectItem(one, "probe_u_m");
    const cJSON *force = cJSON_GetObjectItem(one, "force_z_N"), *energy = cJSON_GetObjectItem(one, "energy_J");
    const cJSON *share = cJSON_GetObjectItem(one, "depth");
    if (cJSON_GetArraySize(u) != PROBES || !cJSON_IsNumber(force) || !cJSON_IsNumber(energy) || !cJSON_IsNumber(share))
        return false;
    for (int i = 0; i < PROBES; i++)
        for (int axis = 0; axis < 3; axis++)
            m->probe_u_m[3 * i + axis] = cJSON_GetNumberValue(cJSON_GetArrayItem(cJSON_GetArrayItem(u, i), axis));
    m->force_z_N = force->valuedouble, m->energy_J = energy->valuedouble, *depth = share->valuedouble;
    return true;
}

tm_status reference_take(const run *r, const char *name, int index, double *depth, measured *m, tm_error *error) {
    if (reference_case(r->truth, name, index, depth, m)) return TM_OK;
    return tm_fail(error, TM_ERR_FILE, -1, "the references hold no case '%s'; make them again", name);
}

/* --- the block --- */

static int32_t node(int n, int i, int j, int k) { return i + (n + 1) * (j + (n + 1) * k); }

tm_status problem_hold(tm_world *world, int32_t count, int32_t *dof, double *value_m, tm_error *error) {
    tm_support_def def = tm_support_def_default();
    def.count = count, def.dof = dof, def.value_m = value_m;
    const tm_status status = tm_stage_support(world, &def, error);
    free(dof);
    free(value_m);
    return status;
}

static double indenter(double x, double y) {
    double s = (x * x + y * y) / (INDENTER_M * INDENTER_M);
    return s < 1 ? (1 - s) * (1 - s) : 0;
}

static tm_status add_supports(const problem_def *def, problem *p, tm_error *error) {
    int n = def->cells;
    size_t most = (size_t)(n + 1) * (n + 1) * 6;
    int32_t *dof = app_zeroed(most, sizeof *dof), count = 0;
    double *value = app_zeroed(most, sizeof *value);
    for (int32_t v = 0; v < p->mesh->vertex_count; v++) {
        int i = v % (n + 1), j = v / (n + 1) % (n + 1), k = v / (n + 1) / (n + 1);
        const double *x = p->mesh->rest_m + 3 * v;
        if (k == 0)
            for (int axis = 0; axis < 3; axis++) dof[count++] = 3 * v + axis;
        if (k > 0 && i == 0) dof[count++] = 3 * v;
        if (k > 0 && j == 0) dof[count++] = 3 * v + 1;
        if (def->pressed && k == n && indenter(x[0], x[1]) > 0) {
            value[count] = -def->depth * BLOCK_M * indenter(x[0], x[1]);
            dof[count++] = 3 * v + 2;
        }
    }
    return problem_hold(p->world, count, dof, value, error);
}

problem_def problem_default(int cells) {
    return (problem_def){.cells = cells,
                         .depth = 0.05,
                         .material = material_liver(),
                         .precision = TM_DOUBLE,
                         .smoothed_shear_share = tm_tissue_def_default().smoothed_shear_share,
                         .pressed = true,
                         .fixed = true,
                         .step_fraction = 0.9};
}

tm_status problem_create(const problem_def *def, problem *p, tm_error *error) {
    app_bench_def bench = app_bench_default(def->cells, BLOCK_M);
    app_bench b;
    bench.material[0] = def->material, bench.fibre = def->fibre, bench.precision = def->precision;
    bench.rotation = def->rotation, bench.viscosity = def->viscosity;
    bench.volume = def->volume, bench.smoothed_shear_share = def->smoothed_shear_share;
    bench.dt_s = def->dt_s, bench.step_fraction = def->step_fraction, bench.held = APP_HELD_NOT;
    *p = (problem){.cells = def->cells, .depth = def->depth};
    tm_status status = app_bench_open(&bench, &b, error);
    if (status != TM_OK) return status;
    p->mesh = b.mesh, p->tissue = b.tissue, p->world = b.world, p->rotation = b.rotation;
    if (def->fixed) status = add_supports(def, p, error);
    if (status != TM_OK) problem_destroy(p);
    return status;
}

void problem_destroy(problem *p) {
    app_bench_close(&(app_bench){p->mesh, p->tissue, p->world, p->rotation});
    memset(p, 0, sizeof *p);
}

static void problem_measure(problem *p, measured *m) {
    int n = p->cells, at = 0;
    const double *u = tm_world_state(p->world)->u_m;
    for (int k = 1; k <= 3; k++)
        for (int j = 1; j <= 3; j++)
            for (int i = 1; i <= 3; i++, at++)
                memcpy(m->probe_u_m + 3 * at, u + 3 * node(n, i * n / 3, j * n / 3, k * n / 3), 3 * sizeof *u);
    m->energy_J = tm_tissue_energy(p->tissue, u) + (p->rotation ? tm_rotation_energy(p->rotation, u) : 0);
    /* Summed from the internal force: exact at rest. */
    const size_t count = 3 * (size_t)p->mesh->vertex_count;
    double *force = app_zeroed(2 * count, sizeof *force), *turned = force + count;
    tm_tissue_force(p->tissue, u, force);
    if (p->rotation) tm_rotation_force(p->rotation, u, turned);
    m->force_z_N = 0;
    for (int32_t v = 0; v < p->mesh->vertex_count; v++) {
        const double *x = p->mesh->rest_m + 3 * v;
        if (v / (n + 1) / (n + 1) == n && indenter(x[0], x[1]) > 0)
            m->force_z_N -= force[3 * v + 2] + turned[3 * v + 2];
    }
    free(force);
}

tm_status problem_settle(problem *p, double tolerance, measured *m, tm_error *error) {
    tm_settle_def def = tm_settle_def_default();
    def.tolerance = tolerance;
    tm_settle_result result;
    tm_status status = tm_world_settle(p->world, &def, &result, error);
    if (status == TM_OK && m) problem_measure(p, m);
    return status;
}

differences compare(const measured *m, const measured *truth) {
    double worst = 0, largest = 0;
    for (int i = 0; i < PROBES; i++) {
        double d = 0, u = 0;
        for (int axis = 0; axis < 3; axis++) {
            double t = truth->probe_u_m[3 * i + axis];
            d += (m->probe_u_m[3 * i + axis] - t) * (m->probe_u_m[3 * i + axis] - t);
            u += t * t;
        }
        worst = fmax(worst, d), largest = fmax(largest, u);
    }
    return (differences){sqrt(worst / largest), fabs(m->force_z_N / truth->force_z_N - 1),
                         fabs(m->energy_J / truth->energy_J - 1)};
}

tm_material material_liver(void) {
    tm_material m;
    if (tm_material_young(5e3, 0.45, &m, NULL) != TM_OK) abort(); /* constants from this file, always valid */
    m.density_kg_m3 = 1060;
    return m;
}

tm_material material_fibre(void) {
    tm_material m;
    if (tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, NULL) != TM_OK) abort();
    m.density_kg_m3 = 1060;
    return m;
}

void time_steps(tm_world **world, int count, int rounds, double *seconds_per_step) {
    enum { MAX_ROUNDS = 25, MAX_WORLDS = 16 };
    static double sample[MAX_WORLDS][MAX_ROUNDS];
    int steps[MAX_WORLDS];
    if (rounds > MAX_ROUNDS) rounds = MAX_ROUNDS;
    for (int w = 0; w < count; w++) { /* as many steps as take about 20 ms */
        double start = app_seconds();
        tm_world_step(world[w], 3);
        double once = (app_seconds() - start) / 3;
        steps[w] = once > 0.02 ? 1 : (int)(0.02 / once);
    }
    for (int r = 0; r < rounds; r++)
        for (int w = 0; w < count; w++) {
            double start = app_seconds();
            tm_world_step(world[w], steps[w]);
            sample[w][r] = (app_seconds() - start) / steps[w];
        }
    for (int w = 0; w < count; w++) seconds_per_step[w] = app_median(sample[w], rounds);
}

tm_status matrix_solve(const run *r, const char *knob, const problem_def *def, int count, double tolerance,
                       const measured *truth, solved *out, tm_error *error) {
    tm_world *world[MATRIX];
    double seconds[MATRIX];
    memset(out, 0, sizeof *out * (size_t)count);
    for (int i = 0; i < count; i++) {
        tm_status status = problem_create(&def[i], &out[i].p, error);
        if (status == TM_OK) status = problem_settle(&out[i].p, tolerance, &out[i].m, error);
        if (status != TM_OK) return status;
        world[i] = out[i].p.world;
        r->progress(knob, (double)(i + 1) / count);
    }
    time_steps(world, count, r->rounds, seconds);
    for (int i = 0; i < count; i++) {
        out[i].seconds_per_step = seconds[i];
        out[i].off = compare(&out[i].m, truth ? truth : &out[0].m);
    }
    return TM_OK;
}

void matrix_free(solved *s, int count) {
    for (int i = 0; i < count; i++) problem_destroy(&s[i].p);
}

cJSON *differences_add(cJSON *to, const differences *d) {
    return app_json_add(to, "displacement %g reaction %g energy %g", d->displacement, d->reaction, d->energy);
}

cJSON *cost_add(cJSON *to, const solved *s) {
    const double step_s = tm_world_step_s(s->p.world);
    return app_json_add(to, "seconds_per_step %g wall_per_simulated %g bytes %g", s->seconds_per_step,
                        s->seconds_per_step / step_s, (double)tm_tissue_bytes(s->p.tissue));
}

measured measured_scaled(const measured *m, double scale) {
    measured out = *m;
    for (int c = 0; c < 3 * PROBES; c++) out.probe_u_m[c] *= scale;
    out.force_z_N *= scale, out.energy_J *= scale * scale;
    return out;
}
