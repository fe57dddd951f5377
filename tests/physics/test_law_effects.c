/* Nonlinear laws with other effects: a linear body beside one of another law. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../fixture.h"
#include "tensormass/cut.h"
#include "tensormass/energy.h"

static const double YOUNG_PA = 5e3, SIDE_M = 0.02;

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n, held;
    int32_t *dof;
    double *value_m;
} body;

/* Constants of each law; `fibred` laws with stiff fibres. */
static tm_material material_of(tm_law_kind law, double poisson, bool fibred) {
    static const double constant[TM_LAW_COUNT][TM_LAW_CONSTANTS] = {[TM_LAW_ST_VENANT_KIRCHHOFF] = {1},
                                                                    [TM_LAW_MOONEY_RIVLIN] = {0.3},
                                                                    [TM_LAW_FUNG] = {20e3},
                                                                    [TM_LAW_HOLZAPFEL] = {4e3, 0.8, 0.1}};
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(YOUNG_PA, poisson, &m, &error), &error);
    if (fibred) m.dmu_Pa = 2 * m.mu_Pa, m.beta_Pa = 3 * m.mu_Pa;
    fix_ok(tm_material_set_law(&m, law, constant[law], 0, &error), &error);
    return m;
}

/* A world of the definition's tissue, with fibres along (1 2 2)/3. */
static body make(tm_mesh *mesh, tm_tissue_def def, int32_t threads, bool damped) {
    body b = {.mesh = mesh, .n = 3 * mesh->vertex_count};
    tm_error error;
    double *fibre = fix_fibres(mesh, (double[]){1 / 3.0, 2 / 3.0, 2 / 3.0});
    def.mesh = mesh, def.fibre = fibre;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    free(fibre);
    tm_world_def world = tm_world_def_default();
    world.tissue = b.tissue, world.threads = threads, world.damped = damped;
    fix_ok(tm_world_create(&world, &b.world, &error), &error);
    b.dof = malloc(sizeof *b.dof * (size_t)b.n);
    b.value_m = malloc(sizeof *b.value_m * (size_t)b.n);
    return b;
}

static void destroy(body *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->dof);
    free(b->value_m);
}

static bool is_at(const body *b, int32_t i, double place_m) { return fabs(b->mesh->rest_m[i] - place_m) < 1e-9; }

static void hold(body *b, int32_t dof, double value_m) { b->dof[b->held] = dof, b->value_m[b->held++] = value_m; }

static void support(body *b) {
    tm_support_def def = tm_support_def_default();
    tm_error error;
    def.count = b->held, def.dof = b->dof, def.value_m = b->value_m;
    fix_ok(tm_stage_support(b->world, &def, &error), &error);
}

static void settle(body *b) {
    tm_settle_def def = tm_settle_def_default();
    tm_error error;
    support(b);
    def.tolerance = 1e-9;
    fix_ok(tm_world_settle(b->world, &def, NULL, &error), &error);
}

/* --- linear materials beside others --- */

/* A block whose upper half is region `upper`, the lower one the other of 0 and 1. */
static tm_mesh *halves(int32_t upper) {
    fix_random random = {11};
    tm_error error;
    tm_mesh *whole = fix_block((int[]){2, 2, 4}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0, &random), *mesh;
    int32_t *region = calloc((size_t)whole->tet_count, sizeof *region);
    for (int32_t t = 0; t < whole->tet_count; t++) {
        double z = 0;
        for (int k = 0; k < 4; k++) z += 0.25 * whole->rest_m[3 * whole->tet[4 * t + k] + 2];
        region[t] = z > SIDE_M / 2 ? upper : 1 - upper;
    }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = whole->vertex_count, def.tet_count = whole->tet_count;
    def.vertex_m = whole->rest_m, def.tet = whole->tet, def.region = region;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(region);
    tm_mesh_destroy(whole);
    return mesh;
}

/* Stress of neo-Hookean tissue that is stretched along one axis and held across: dW/ds with I = s^2 + 2, J = s. */
static double confined_Pa(const tm_material *m, double s) {
    const double k = 4.0 / 3 * m->mu_Pa, l = m->lambda_Pa + 5.0 / 6 * m->mu_Pa, J1 = s - 1;
    return k * s - k * s / (s * s + 3) + l * J1 - 0.75 * k;
}

/* A stiff linear slab under a neo-Hookean one, held at the sides and pressed by 20 %: each is strained evenly, by the
 * stress that both share. The linear material is the first in the list, or the last. */
static void presses_a_linear_body_beside_another(void **state) {
    (void)state;
    const tm_material soft = material_of(TM_LAW_NEO_HOOKE, 0.3, false);
    tm_material hard = material_of(TM_LAW_LINEAR, 0.3, false);
    hard.lambda_Pa *= 20, hard.mu_Pa *= 20;
    double low = -0.4, high = 0, e = 0; /* strain of the linear half; the other's is -0.4 - e */
    for (int k = 0; k < 60; k++) {
        e = 0.5 * (low + high);
        *((hard.lambda_Pa + 2 * hard.mu_Pa) * e < confined_Pa(&soft, 1 - 0.4 - e) ? &low : &high) = e;
    }
    for (int32_t upper = 0; upper < 2; upper++) {
        const tm_material both[2] = {upper ? hard : soft, upper ? soft : hard};
        tm_tissue_def def = tm_tissue_def_default();
        tm_error error;
        def.material_count = 2, def.material = both;
        body b = make(halves(upper), def, 1, true);
        for (int32_t i = 0; i < b.n; i++) {
            const bool top = is_at(&b, i / 3 * 3 + 2, SIDE_M), side = i % 3 < 2;
            if (top || is_at(&b, i / 3 * 3 + 2, 0) || (side && (is_at(&b, i, 0) || is_at(&b, i, SIDE_M))))
                hold(&b, i, top && !side ? -0.2 * SIDE_M : 0);
        }
        settle(&b);
        const double *u = tm_world_state(b.world)->u_m;
        for (int32_t i = 2; i < b.n; i += 3) {
            const double z = b.mesh->rest_m[i], half_m = SIDE_M / 2;
            const double exact = z < half_m ? e * z : e * half_m + (-0.4 - e) * (z - half_m);
            assert_true(fabs(u[i] - exact) < 1e-6 * SIDE_M);
        }
        fix_ok(tm_world_step(b.world, 50), &error);
        assert_true(fabs(u[2] - tm_world_state(b.world)->u_m[2]) < 1e-6 * SIDE_M);
        destroy(&b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(presses_a_linear_body_beside_another),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
