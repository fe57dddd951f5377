/* A world of tissue with one law, for tests of nonlinear laws with other effects. */
#ifndef TM_TEST_LAW_BODY_H
#define TM_TEST_LAW_BODY_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "law_rows.h"

static const double YOUNG_PA = 5e3, SIDE_M = 0.02;

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n, held;
    int32_t *dof;
    double *value_m;
} body;

/* Returns the constants of each law; `fibred` laws get stiff fibres. */
static inline tm_material material_of(tm_law_kind law, double poisson, bool fibred) {
    double constant[TM_LAW_CONSTANTS];
    law_example(law, constant);
    if (law == TM_LAW_ST_VENANT_KIRCHHOFF) constant[0] = 1, constant[1] = 0; /* does not collapse; linear at rest */
    if (law == TM_LAW_FUNG) constant[0] = 20e3, constant[1] = 0;             /* linear at rest */
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(YOUNG_PA, poisson, &m, &error), &error);
    if (fibred) m.dmu_Pa = 2 * m.mu_Pa, m.beta_Pa = 3 * m.mu_Pa;
    fix_ok(tm_material_set_law(&m, law, constant, 0, &error), &error);
    return m;
}

static const double FIBRE[3] = {1 / 3.0, 2 / 3.0, 2 / 3.0};

static inline body world_of(tm_mesh *mesh, tm_tissue *tissue, int32_t threads, bool damped) {
    body b = {.mesh = mesh, .tissue = tissue, .n = 3 * mesh->vertex_count};
    tm_error error;
    tm_world_def world = tm_world_def_default();
    world.tissue = tissue, world.threads = threads, world.damped = damped;
    fix_ok(tm_world_create(&world, &b.world, &error), &error);
    b.dof = malloc(sizeof *b.dof * (size_t)b.n);
    b.value_m = malloc(sizeof *b.value_m * (size_t)b.n);
    return b;
}

/* Makes a world from the definition's tissue, with fibres. */
static inline body make(tm_mesh *mesh, tm_tissue_def def, int32_t threads, bool damped) {
    tm_tissue *tissue;
    tm_error error;
    double *fibre = fix_fibres(mesh, FIBRE);
    def.mesh = mesh, def.fibre = fibre;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    free(fibre);
    return world_of(mesh, tissue, threads, damped);
}

static inline void destroy(body *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->dof);
    free(b->value_m);
}

static inline bool is_at(const body *b, int32_t i, double place_m) { return fabs(b->mesh->rest_m[i] - place_m) < 1e-9; }

static inline void hold(body *b, int32_t dof, double value_m) {
    b->dof[b->held] = dof, b->value_m[b->held++] = value_m;
}

static inline void support(body *b) {
    tm_support_def def = tm_support_def_default();
    tm_error error;
    def.count = b->held, def.dof = b->dof, def.value_m = b->value_m;
    fix_ok(tm_stage_support(b->world, &def, &error), &error);
}

static inline void settle(body *b) {
    tm_settle_def def = tm_settle_def_default();
    tm_error error;
    support(b);
    def.tolerance = 1e-9;
    fix_ok(tm_world_settle(b->world, &def, NULL, &error), &error);
}

#endif
