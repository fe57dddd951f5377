/* The effect "strain_smoothing": error against cost on the pressed block, for linear tetrahedra and three shares of the
 * shear; deflection of a cantilever against Timoshenko's beam, from nu = 0.3 towards 0.5. Reference for the block:
 * CalculiX ("iso"). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "accuracy.h"
#include "bandwidth.h"
#include "bench.h"

enum { FORMS = 4, NUS = 5 };

/* Below 0: linear tetrahedra. */
static const double shears[FORMS] = {-1, 0.4, 0.75, 1};

/* Solves all forms on one mesh, timed in turns. */
static tm_status one_mesh(const run *r, int cells, const measured *truth, double depth, cJSON *rows, tm_error *error) {
    solved s[FORMS];
    problem_def def[FORMS];
    for (int f = 0; f < FORMS; f++) {
        def[f] = problem_default(cells);
        def[f].depth = depth, def[f].volume = shears[f] >= 0, def[f].smoothed_shear_share = shears[f];
    }
    const tm_status status = matrix_solve(r, "strain_smoothing", def, FORMS, 1e-9, truth, s, error);
    for (int f = 0; f < FORMS && status == TM_OK; f++) {
        const tm_tissue *tissue = s[f].p.tissue;
        double estimate = NAN;
        tm_error ignored;
        if (tm_critical_step_estimate(tissue, NULL, 1e-4, 100000, &estimate, &ignored)) estimate = NAN;
        cJSON *row = app_json_add(rows, "form %s shear %g tets %d step_s %g sharp_s %f pairs %d",
                                  shears[f] < 0 ? "linear" : "strain_smoothing", shears[f] < 0 ? 0 : shears[f],
                                  s[f].p.mesh->tet_count, tm_critical_step_guaranteed(tissue, NULL), estimate,
                                  tm_tissue_pairs(tissue).count);
        cost_add(differences_add(row, &s[f].off), &s[f]);
    }
    matrix_free(s, FORMS);
    return status;
}

/* --- the cantilever --- */

static const double SIDE_M = 0.1, LENGTH_M = 0.6, YOUNG_PA = 1e4, PULL_N = 1e-3;

/* Distributes the load along x over the triangles of the free end. */
static void pull_end(const tm_mesh *mesh, double *load) {
    double area = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int32_t s = 0; s < mesh->surface_count; s++) { /* the end's triangles have equal areas */
            const int32_t *v = mesh->surface + 3 * s;
            double z = 0;
            for (int k = 0; k < 3; k++) z += mesh->rest_m[3 * v[k] + 2];
            if (z < 3 * LENGTH_M - 1e-9) continue;
            if (pass == 0) area++;
            for (int k = 0; pass == 1 && k < 3; k++) load[3 * v[k]] += PULL_N / area / 3;
        }
}

/* Computes the deflection at the load over Timoshenko's. */
static tm_status tip(double nu, double shear, double *ratio, tm_error *error) {
    app_bench_def def = app_bench_default(4, SIDE_M);
    app_bench b = {0};
    double moved = 0;
    def.cells[2] = 24, def.size_m[2] = LENGTH_M, def.volume = shear >= 0;
    if (def.volume) def.smoothed_shear_share = shear;
    tm_status status = tm_material_young(YOUNG_PA, nu, &def.material[0], error);
    if (status == TM_OK) status = app_bench_open(&def, &b, error);
    if (status != TM_OK) return status;
    double *load = app_zeroed(3 * (size_t)b.mesh->vertex_count, sizeof *load);
    pull_end(b.mesh, load);
    status = tm_stage_load(b.world, load, error);
    tm_settle_def settle = tm_settle_def_default();
    tm_settle_result result;
    settle.tolerance = 1e-9;
    if (status == TM_OK) status = tm_world_settle(b.world, &settle, &result, error);
    for (int32_t d = 0; status == TM_OK && d < 3 * b.mesh->vertex_count; d++)
        moved += load[d] * tm_world_state(b.world)->u_m[d] / PULL_N;
    const double inertia = pow(SIDE_M, 4) / 12, shear_Pa = YOUNG_PA / (2 * (1 + nu));
    *ratio = moved / (PULL_N * pow(LENGTH_M, 3) / (3 * YOUNG_PA * inertia) +
                      PULL_N * LENGTH_M / (shear_Pa * 5 / 6 * SIDE_M * SIDE_M));
    free(load);
    app_bench_close(&b);
    return status;
}

static tm_status cantilevers(const run *r, cJSON *rows, tm_error *error) {
    static const double nus[NUS] = {0.3, 0.45, 0.49, 0.499, 0.4999};
    tm_status status = TM_OK;
    const int count = r->quick ? NUS - 1 : NUS;
    for (int n = 0; n < count && status == TM_OK; n++) {
        cJSON *row = app_json_add(rows, "nu %g", nus[n]);
        for (int f = 0; f < FORMS && status == TM_OK; f++) {
            char name[24] = "linear";
            double ratio = NAN;
            if (shears[f] >= 0) snprintf(name, sizeof name, "shear_%g", shears[f]);
            status = tip(nus[n], shears[f], &ratio, error);
            cJSON_AddNumberToObject(row, name, ratio);
        }
        r->progress("strain_smoothing, cantilever", (double)(n + 1) / count);
    }
    return status;
}

tm_status knob_strain_smoothing(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    measured truth;
    double depth;
    tm_status status = reference_take(r, "iso", 0, &depth, &truth, error);
    for (int cells = 3; cells <= (r->quick ? 9 : 18) && status == TM_OK; cells += 3)
        status = one_mesh(r, cells, &truth, depth, rows, error);
    return status ? status : cantilevers(r, cJSON_AddArrayToObject(out, "cantilever"), error);
}
