/* Shared by the tests of libtensormass_solve. */
#ifndef SOLVE_KIT_H
#define SOLVE_KIT_H

#include "../fixture.h"
#include "../long.h"

#include "tensormass_solve.h"

/* Fixes every vertex with x below `to`; [3*vertex_count], to free. */
static inline uint8_t *kit_clamp(const tm_mesh *mesh, double to) {
    uint8_t *fixed = calloc(3 * (size_t)mesh->vertex_count, 1);
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++) fixed[d] = mesh->rest_m[d / 3 * 3] < to;
    return fixed;
}

static inline tm_solve_def kit_problem(const tm_tissue *tissue, const uint8_t *fixed) {
    tm_solve_def def = tm_solve_def_default();
    def.tissue = tissue;
    def.fixed = fixed;
    return def;
}

/* Returns the largest difference over the components of `a`, relative to the largest of `b`. */
static inline double kit_difference(const double *a, const double *b, int32_t n) {
    double worst = 0;
    for (int32_t i = 0; i < n; i++) worst = fmax(worst, fabs(a[i] - b[i]));
    return worst / fix_largest(b, n);
}

/* Adds the support stage of the same mask. */
static inline void kit_support(tm_world *world, const uint8_t *fixed, const double *value) {
    const int32_t n = 3 * tm_tissue_mesh(tm_world_tissue(world))->vertex_count;
    int32_t *dof = malloc(sizeof(int32_t) * (size_t)n);
    double *at = calloc((size_t)n, 8);
    tm_support_def def = tm_support_def_default();
    for (int32_t d = 0; d < n; d++)
        if (fixed[d]) at[def.count] = value ? value[d] : 0, dof[def.count++] = d;
    def.dof = dof;
    def.value_m = at;
    tm_error error;
    fix_ok(tm_stage_support(world, &def, &error), &error);
    free(dof);
    free(at);
}

static inline tm_material kit_material(double young_Pa, double poisson) {
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(young_Pa, poisson, &m, &error), &error);
    return m;
}

static inline void kit_settle(tm_world *world) {
    tm_settle_def settle = tm_settle_def_default();
    settle.tolerance = 1e-11;
    tm_settle_result result;
    tm_error error;
    fix_ok(tm_world_settle(world, &settle, &result, &error), &error);
}

#endif
