/* Fibred tissue of St. Venant-Kirchhoff's and Fung's law compressed along its fibres: stiff fibres that push make it
 * lose ellipticity, by shear along the fibres, and a block collapses; with `slack` it holds to a press of 40 %. */
#include <math.h>
#include <stdlib.h>

#include "../fixture.h"
#include "base/vec.h"
#include "material/hyperelastic.h"

static const double SIDE_M = 0.02, RATIO = 5, ACROSS_PA = 6e3, SHEAR_PA = 5e3;

static const tm_law_kind laws[2] = {TM_LAW_ST_VENANT_KIRCHHOFF, TM_LAW_FUNG};

static tm_material material_of(tm_law_kind law, double slack) {
    tm_material m;
    tm_error error;
    const double constant[TM_LAW_CONSTANTS] = {law == TM_LAW_FUNG ? 20e3 : 1, slack};
    fix_ok(tm_material_engineering(RATIO * ACROSS_PA, ACROSS_PA, 0.4, 0.45, SHEAR_PA, &m, &error), &error);
    fix_ok(tm_material_set_law(&m, law, constant, 0, &error), &error);
    return m;
}

/* --- a uniform state: F = diag(t, t, s), fibres along z, sides free --- */

typedef struct uniform {
    tm_mesh *mesh;
    tm_material material;
    tm_pool pool;
    tm_hyperelastic hyper;
} uniform;

static void make_uniform(uniform *b, tm_law_kind law, double slack) {
    static const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, fibre[3] = {0, 0, 1};
    static const uint8_t alive = 1;
    static const int32_t own = 0;
    tm_error error;
    *b = (uniform){.material = material_of(law, slack)};
    fix_ok(fix_one_tet(corner, &b->mesh, &error), &error);
    const tm_material_field field = {.mesh = b->mesh,
                                     .alive = &alive,
                                     .material = &b->material,
                                     .region_material = &own,
                                     .material_count = 1,
                                     .fibre = fibre};
    assert_true(tm_hyperelastic_take(&b->hyper, &b->pool, &field));
}

static void displace(double across, double along, double u[12]) {
    const double F[3] = {across, across, along};
    for (int i = 0; i < 12; i++) u[i] = i / 3 == i % 3 + 1 ? F[i % 3] - 1 : 0;
}

/* Returns the stretch across at which the sides are free: W is least there. */
static double free_sides(const uniform *b, double along) {
    double low = 0.9, high = 1.6, u[12];
    for (int k = 0; k < 80; k++) {
        const double a = low + (high - low) / 3, c = high - (high - low) / 3;
        displace(a, along, u);
        const double at_a = tm_hyperelastic_tet_energy(&b->hyper, 0, u);
        displace(c, along, u);
        if (at_a < tm_hyperelastic_tet_energy(&b->hyper, 0, u))
            high = c;
        else
            low = a;
    }
    return 0.5 * (low + high);
}

/* Returns the least eigenvalue of the acoustic tensor over all directions, in units of the shear modulus. */
static double ellipticity(const uniform *b, double along) {
    double u[12], A[81], least = HUGE_VAL;
    displace(free_sides(b, along), along, u);
    tm_hyperelastic_hessian(&b->hyper, 0, u, A);
    for (int degrees = 0; degrees <= 90; degrees += 2) {
        const double n[3] = {sin(degrees * M_PI / 180), 0, cos(degrees * M_PI / 180)};
        double Q[9] = {0};
        for (int i = 0; i < 81; i++) Q[i / 27 * 3 + i % 9 / 3] += A[i] * n[i / 9 % 3] * n[i % 3];
        for (int sweep = 0; sweep < 8; sweep++)
            for (int p = 0; p < 2; p++)
                for (int q = p + 1; q < 3; q++) tm_jacobi(Q, 3, p, q, &(double){0}, &(double){0});
        least = fmin(least, fmin(Q[0], fmin(Q[4], Q[8])));
    }
    return least / b->mesh->volume_m3[0] / SHEAR_PA;
}

/* Returns the stretch along the fibre at which ellipticity is lost, 0.5 if it is not. */
static double lost_at(tm_law_kind law, double slack) {
    uniform b;
    make_uniform(&b, law, slack);
    double along = 1;
    while (along > 0.5 && ellipticity(&b, along) > 0) along -= 0.01;
    print_message("%s, slack %.1f: elliptic to a stretch of %.2f; %.2f of the shear modulus at 0.6\n", tm_law_name(law),
                  slack, along, ellipticity(&b, 0.6));
    tm_pool_release(&b.pool);
    tm_mesh_destroy(b.mesh);
    return along;
}

static void fibres_that_push_lose_ellipticity(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        const double stiff = lost_at(laws[i], 0), half = lost_at(laws[i], 0.5), slack = lost_at(laws[i], 1);
        assert_true(stiff > 0.7 && stiff < 0.85 && half < 0.6 && slack < 0.51);
    }
}

/* --- a block between plates --- */

typedef struct block {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t *dof, count;
} block;

static block make_block(tm_law_kind law, double slack) {
    block b = {0};
    fix_random random = {1};
    const tm_material m = material_of(law, slack);
    tm_error error;
    b.mesh = fix_block((int[]){4, 4, 4}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.2, &random);
    b.tissue = fix_tissue(b.mesh, &m, (double[]){0, 0, 1}, TM_DOUBLE, false);
    b.world = fix_world(b.tissue, true);
    const int32_t n = 3 * b.mesh->vertex_count;
    b.dof = malloc(sizeof *b.dof * (size_t)n);
    double *zero = calloc((size_t)n, sizeof *zero);
    for (int32_t i = 0; i < n; i++) {
        const double z = b.mesh->rest_m[i / 3 * 3 + 2];
        if (z < 1e-9 || z > SIDE_M - 1e-9) b.dof[b.count++] = i;
    }
    tm_support_def def = tm_support_def_default();
    def.count = b.count, def.dof = b.dof, def.value_m = zero;
    fix_ok(tm_stage_support(b.world, &def, &error), &error);
    free(zero);
    return b;
}

/* Returns the reaction, N, at rest under a press; `inverted`: tetrahedra. */
static double press(const block *b, double share, int32_t *inverted) {
    tm_settle_def def = tm_settle_def_default();
    tm_settle_result result;
    tm_error error;
    double reaction_N = 0;
    for (int32_t i = 0; i < b->count; i++)
        if (b->dof[i] % 3 == 2 && b->mesh->rest_m[b->dof[i]] > SIDE_M / 2)
            tm_support_move(b->world, i, -share * SIDE_M);
    def.tolerance = 1e-8;
    fix_ok(tm_world_settle(b->world, &def, &result, &error), &error);
    const tm_state *s = tm_world_state(b->world);
    for (int32_t i = 0; i < b->count; i++)
        if (b->dof[i] % 3 == 2 && b->mesh->rest_m[b->dof[i]] > SIDE_M / 2) reaction_N += s->force_N[b->dof[i]];
    *inverted = tm_tissue_deformation(b->tissue, s->u_m).inverted;
    return reaction_N;
}

static void a_block_holds_with_slack(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        const int slack = i % 2;
        block b = make_block(laws[i / 2], slack);
        double previous_N = 0;
        bool holds = true;
        for (int step = 1; step <= (slack ? 8 : 6); step++) {
            int32_t inverted;
            const double reaction_N = press(&b, 0.05 * step, &inverted);
            print_message("%s, slack %d, pressed by %d %%: %.3f N, %d inverted\n", tm_law_name(laws[i / 2]), slack,
                          5 * step, reaction_N, inverted);
            holds = holds && reaction_N > previous_N && inverted == 0;
            previous_N = reaction_N;
        }
        assert_true(holds == slack);
        tm_world_destroy(b.world), tm_tissue_destroy(b.tissue), tm_mesh_destroy(b.mesh);
        free(b.dof);
    }
}

/* A uniform strain: all of the volume has lost its ellipticity beyond the stretch of the law alone, and none before. */
static void share_of_unstable_volume_is_told(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        const double lost = lost_at(laws[i / 2], i % 2), side = lost > 0.5 ? lost : 0.56;
        uniform u;
        block b = make_block(laws[i / 2], i % 2);
        make_uniform(&u, laws[i / 2], i % 2);
        for (int k = -1; k <= 1; k += 2) {
            const double along = side + 0.05 * k, across = free_sides(&u, along);
            for (int32_t j = 0; j < 3 * b.mesh->vertex_count; j++)
                tm_world_state(b.world)->u_m[j] = b.mesh->rest_m[j] * ((j % 3 == 2 ? along : across) - 1);
            const double share = tm_world_unstable_share(b.world);
            print_message("%s, slack %d, stretch %.2f: %.3f\n", tm_law_name(laws[i / 2]), i % 2, along, share);
            assert_true(fabs(share - (k < 0 && i % 2 == 0)) < 1e-12);
        }
        tm_pool_release(&u.pool);
        tm_mesh_destroy(u.mesh);
        tm_world_destroy(b.world), tm_tissue_destroy(b.tissue), tm_mesh_destroy(b.mesh);
        free(b.dof);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(fibres_that_push_lose_ellipticity),
                                       cmocka_unit_test(a_block_holds_with_slack),
                                       cmocka_unit_test(share_of_unstable_volume_is_told)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
