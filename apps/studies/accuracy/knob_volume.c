/* The effect "volume": error against price on the pressed block, linear tetrahedra beside three shares of the shear;
 * and how far the tip of a cantilever goes, against Timoshenko's beam, from nu = 0.3 towards 0.5. Truth of the block:
 * CalculiX ("iso"). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "accuracy.h"
#include "block.h"

enum { FORMS = 4, NUS = 5 };

/* Below 0: linear tetrahedra. */
static const double shears[FORMS] = {-1, 0.4, 0.75, 1};

static void set_form(tm_tissue_def *def, double shear) {
    def->volume = shear >= 0;
    if (def->volume) def->volume_shear = shear;
}

/* All forms on one mesh, timed side by side. */
static tm_status one_mesh(const run *r, int cells, const measured *truth, double depth, cJSON *rows, tm_error *error) {
    solved s[FORMS];
    problem_def def[FORMS];
    for (int f = 0; f < FORMS; f++) {
        def[f] = problem_default(cells);
        def[f].depth = depth, def[f].volume = shears[f] >= 0, def[f].volume_shear = shears[f];
    }
    const tm_status status = matrix_solve(r, "volume", def, FORMS, 1e-9, truth, s, error);
    for (int f = 0; f < FORMS && status == TM_OK; f++) {
        const tm_tissue *tissue = s[f].p.tissue;
        double sharp = NAN;
        tm_error ignored;
        if (tm_critical_step_sharp(tissue, NULL, 1e-4, 100000, &sharp, &ignored)) sharp = NAN;
        cJSON *row =
            app_json_add(rows, "form %s shear %g tets %d step_s %g sharp_s %f pairs %d",
                         shears[f] < 0 ? "linear" : "volume", shears[f] < 0 ? 0 : shears[f], s[f].p.mesh->tet_count,
                         tm_critical_step_guaranteed(tissue, NULL), sharp, tm_tissue_pairs(tissue).count);
        price_add(differences_add(row, &s[f].off), &s[f]);
    }
    matrix_free(s, FORMS);
    return status;
}

/* --- the cantilever --- */

static const double SIDE_M = 0.1, LENGTH_M = 0.6, YOUNG_PA = 1e4, PULL_N = 1e-3;

/* Clamped at z = 0; the pull along x spread over the triangles of the other end. */
static tm_status hold_and_pull(tm_world *world, const tm_mesh *mesh, double *load, tm_error *error) {
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)mesh->vertex_count), count = 0;
    double *rest = calloc(3 * (size_t)mesh->vertex_count, sizeof *rest), area = 0;
    for (int32_t d = 0; dof && d < 3 * mesh->vertex_count; d++)
        if (mesh->rest_m[d / 3 * 3 + 2] < 1e-9) dof[count++] = d;
    tm_status status = problem_hold(world, count, dof, rest, error);
    for (int pass = 0; pass < 2; pass++)
        for (int32_t s = 0; s < mesh->surface_count; s++) { /* the end's triangles are all alike */
            const int32_t *v = mesh->surface + 3 * s;
            double z = 0;
            for (int k = 0; k < 3; k++) z += mesh->rest_m[3 * v[k] + 2];
            if (z < 3 * LENGTH_M - 1e-9) continue;
            if (pass == 0) area++;
            for (int k = 0; pass == 1 && k < 3; k++) load[3 * v[k]] += PULL_N / area / 3;
        }
    return status ? status : tm_stage_load(world, load, error);
}

/* Way of the pull over Timoshenko's. */
static tm_status tip(const tm_mesh *mesh, double nu, double shear, double *ratio, tm_error *error) {
    tm_material material;
    tm_tissue *tissue = NULL;
    tm_world *world = NULL;
    double *load = calloc(3 * (size_t)mesh->vertex_count, sizeof *load), moved = 0;
    tm_status status = load ? tm_material_young(YOUNG_PA, nu, &material, error) : problem_no_memory(error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material;
    set_form(&def, shear);
    if (status == TM_OK) status = tm_tissue_create(&def, &tissue, error);
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = tissue;
    if (status == TM_OK) status = tm_world_create(&world_def, &world, error);
    if (status == TM_OK) status = hold_and_pull(world, mesh, load, error);
    tm_settle_def settle = tm_settle_def_default();
    tm_settle_result result;
    settle.tolerance = 1e-9;
    if (status == TM_OK) status = tm_world_settle(world, &settle, &result, error);
    for (int32_t d = 0; status == TM_OK && d < 3 * mesh->vertex_count; d++)
        moved += load[d] * tm_world_state(world)->u_m[d] / PULL_N;
    const double inertia = pow(SIDE_M, 4) / 12, shear_Pa = YOUNG_PA / (2 * (1 + nu));
    *ratio = moved / (PULL_N * pow(LENGTH_M, 3) / (3 * YOUNG_PA * inertia) +
                      PULL_N * LENGTH_M / (shear_Pa * 5 / 6 * SIDE_M * SIDE_M));
    free(load);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    return status;
}

static tm_status cantilevers(const run *r, cJSON *rows, tm_error *error) {
    static const double nus[NUS] = {0.3, 0.45, 0.49, 0.499, 0.4999};
    app_block block;
    tm_mesh *mesh = NULL;
    if (!app_block_make(&block, (int32_t[3]){4, 4, 24}, (double[3]){SIDE_M, SIDE_M, LENGTH_M}))
        return problem_no_memory(error);
    tm_status status = app_block_mesh(&block, NULL, &mesh, error);
    app_block_free(&block);
    const int count = r->quick ? NUS - 1 : NUS;
    for (int n = 0; n < count && status == TM_OK; n++) {
        cJSON *row = app_json_add(rows, "nu %g", nus[n]);
        for (int f = 0; f < FORMS && status == TM_OK; f++) {
            char name[24] = "linear";
            double ratio = NAN;
            if (shears[f] >= 0) snprintf(name, sizeof name, "shear_%g", shears[f]);
            status = tip(mesh, nus[n], shears[f], &ratio, error);
            cJSON_AddNumberToObject(row, name, ratio);
        }
        r->progress("volume, cantilever", (double)(n + 1) / count);
    }
    tm_mesh_destroy(mesh);
    return status;
}

tm_status knob_volume(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    measured truth;
    double depth;
    tm_status status = reference_take(r, "iso", 0, &depth, &truth, error);
    for (int cells = 3; cells <= (r->quick ? 9 : 18) && status == TM_OK; cells += 3)
        status = one_mesh(r, cells, &truth, depth, rows, error);
    return status ? status : cantilevers(r, cJSON_AddArrayToObject(out, "cantilever"), error);
}
