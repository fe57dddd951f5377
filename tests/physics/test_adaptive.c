/* Adaptive step (tm_world_adapt): tissue that stiffens exponentially, pressed by 40 % and released. It takes the
 * long step at rest and 2^k substeps only while pressed deep; it stays stable; its energy account closes over the
 * changes. Results are bit-identical by threads and snapshots. The bound by strain is never exceeded. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../fixture.h"
#include "law_rows.h"
#include "material/hyperelastic.h"
#include "released.h"
#include "tensormass/cut.h"
#include "world/world_internal.h"

static const double SIDE_M = 0.02;

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n, held, top; /* components of the support; the top's start here */
    double depth, press_s;
} body;

/* Pressed: Fung's exponential law. Pulled: fibres along the pull, which stiffen a thousandfold up to the permitted
 * stretch. */
static tm_material exponential(bool pulled) {
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.4, &m, &error), &error);
    const double constant[2][TM_LAW_CONSTANTS] = {{1.2e3}, {4e3, 1.5}};
    fix_ok(tm_material_set_law(&m, pulled ? TM_LAW_HOLZAPFEL : TM_LAW_FUNG, constant[pulled], 0, &error), &error);
    m.damping_1_s = 20;
    return m;
}

/* Ramps from 0 to 1 in `press_s`, stays as long, and returns. */
static double pressed(const body *b, double time_s) {
    const double at = time_s / b->press_s, x = at < 1 ? at : at < 2 ? 1 : at < 3 ? 3 - at : 0;
    return x * x * (3 - 2 * x);
}

static void move_top(void *self, tm_world *world) {
    const body *b = self;
    const double u = -b->depth * SIDE_M * pressed(b, world->state.time_s + world->state.dt_s);
    for (int32_t i = b->top; i < b->held; i++) tm_support_move(world, i, u);
}

/* Fixes three planes of symmetry without friction, and the plate that presses or pulls the tissue. */
static void support(body *b) {
    int32_t *dof = malloc(sizeof *dof * (size_t)b->n);
    double *zero = calloc((size_t)b->n, sizeof *zero);
    tm_error error;
    for (int32_t i = 0; i < b->n; i++)
        if (fabs(b->mesh->rest_m[i]) < 1e-9) dof[b->held++] = i;
    b->top = b->held;
    for (int32_t i = 2; i < b->n; i += 3)
        if (fabs(b->mesh->rest_m[i] - SIDE_M) < 1e-9) dof[b->held++] = i;
    tm_support_def def = tm_support_def_default();
    def.count = b->held, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(b->world, &def, &error), &error);
    const tm_stage stage = {.size = sizeof stage,
                            .name = "press",
                            .phase = TM_PHASE_BEGIN,
                            .run = move_top,
                            .self = b,
                            .needs = {"support"}};
    fix_ok(tm_world_add_stage(b->world, &stage, 0, &error), &error);
    free(dof), free(zero);
}

static void make_with(body *b, const int cells[3], int32_t threads, double depth, bool averaged) {
    fix_random random = {11};
    tm_error error;
    const tm_material m = exponential(depth < 0);
    *b = (body){.mesh = fix_block(cells, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.2, &random), .depth = depth};
    b->n = 3 * b->mesh->vertex_count;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b->mesh, def.material_count = 1, def.material = &m, def.fibre = fix_fibres(b->mesh, (double[]){0, 0, 1});
    def.strain_smoothing = averaged, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &b->tissue, &error), &error);
    free((void *)def.fibre);
    tm_world_def world = tm_world_def_default();
    world.tissue = b->tissue, world.threads = threads;
    fix_ok(tm_world_create(&world, &b->world, &error), &error);
    const double step_s = 0.9 * tm_adaptive_longest_s(b->tissue);
    assert_true(step_s > 2 * tm_world_step_s(b->world));
    b->press_s = 250 * step_s;
    fix_ok(tm_world_adapt(b->world, step_s, &error), &error);
    support(b);
}

static void make(body *b, const int cells[3], int32_t threads, double depth) {
    make_with(b, cells, threads, depth, false);
}

static void destroy(body *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
}

static tm_adaptive_step now(const body *b) {
    tm_adaptive_step a;
    assert_true(tm_world_adaptive(b->world, &a));
    return a;
}

static void goes_deep_and_back(double depth, bool averaged) {
    body b;
    tm_error error;
    tm_energy e;
    make_with(&b, (int[]){3, 3, 3}, 1, depth, averaged);
    fix_ok(tm_stage_energy(b.world, &error), &error);
    const double step_s = now(&b).step_s;
    int32_t deepest = 0, done = 0;
    double most_J = 0;
    for (; done < 1000; done++) {
        fix_ok(tm_world_step(b.world, 1), &error);
        const tm_adaptive_step a = now(&b);
        assert_true(fabs(b.world->state.time_s - (done + 1) * step_s) < 1e-9 * step_s * (done + 1));
        assert_true(fabs(b.world->state.dt_s * (1 << a.level) - step_s) < 1e-12 * step_s);
        if (done < 50) assert_int_equal(a.level, 0);
        deepest = a.level > deepest ? a.level : deepest;
        fix_ok(tm_world_energy(b.world, &e, &error), &error);
        most_J = fmax(most_J, e.kinetic_J + e.elastic_J);
        assert_true(fabs(e.residual_J) < 1e-3 * most_J + 1e-12);
        if (done == 700) assert_true(fabs(e.state_change_J) < 0.02 * most_J);
    }
    const tm_adaptive_step a = now(&b);
    print_message("%d levels, step %.3g s, strains %.3g %.3g %.3g; steps at level 0, 1, 2: %d %d %d; residual %.2g, "
                  "changes %.2g of %.3g J\n",
                  a.levels, step_s, a.strain[0], a.strain[1], a.strain[2], (int)a.steps[0], (int)a.steps[1],
                  (int)a.steps[2], e.residual_J / most_J, e.state_change_J / most_J, most_J);
    assert_true(deepest >= 1 && a.level == 0 && a.steps[0] > 400);
    assert_true(fix_largest(b.world->state.u_m, b.n) < 1e-3 * SIDE_M);
    assert_int_equal(tm_world_set_step(b.world, 0.5 * step_s, &error), TM_ERR_EXCLUDED);
    destroy(&b);
}

static void deep_tissue_takes_short_steps_only_while_deep(void **state) {
    (void)state;
    for (int averaged = 0; averaged < 2; averaged++)
        goes_deep_and_back(averaged ? 0.45 : 0.5, averaged), goes_deep_and_back(-0.45, averaged);
}

static uint64_t story(int32_t threads, int32_t snapshot_at) {
    body b;
    tm_error error;
    make(&b, (int[]){10, 10, 7}, threads, 0.4);
    b.press_s /= 8;
    assert_int_equal(tm_world_partitions(b.world), threads);
    for (int32_t k = 0; k < 60; k += 4) {
        fix_ok(tm_world_step(b.world, 4), &error);
        if (k != snapshot_at) continue;
        assert_true(now(&b).level > 0);
        step_and_go_back(b.world, 40);
    }
    assert_true(now(&b).steps[0] > 0 && now(&b).steps[0] < 60);
    const uint64_t hash = tm_world_hash(b.world);
    destroy(&b);
    return hash;
}

static void has_the_same_bits_by_threads_and_snapshots(void **state) {
    (void)state;
    const uint64_t one = story(1, -1);
    assert_true(one == story(2, 44));
}

/* A failed call restores the level, the step and every bit. */
static void a_failed_call_is_rolled_back(void **state) {
    (void)state;
    body b;
    tm_error error;
    make(&b, (int[]){3, 3, 3}, 1, 0.5);
    fix_ok(tm_world_step(b.world, 20), &error);
    const uint64_t hash = tm_world_hash(b.world);
    const double dt_s = b.world->state.dt_s, largest_m = b.world->largest_m;
    b.world->largest_m = 0.3 * SIDE_M;
    assert_int_equal(tm_world_step(b.world, 400), TM_ERR_UNSTABLE);
    assert_true(hash == tm_world_hash(b.world) && b.world->state.dt_s == dt_s && now(&b).steps[0] == 20);
    b.world->largest_m = largest_m;
    fix_ok(tm_world_step(b.world, 1), &error);
    destroy(&b);
}

/* Random states within a strain, and states found by ascent: none is stiffer than the bound by strain. */
static void the_bound_by_strain_holds(void **state) {
    (void)state;
    fix_random random = {5};
    tm_error error;
    for (int law = 1; law < TM_LAW_COUNT; law++) {
        if (!law_is_tested((tm_law_kind)law)) continue;
        tm_material m;
        fix_ok(tm_material_young(5e3, 0.45, &m, &error), &error);
        law_set(&m, (tm_law_kind)law);
        const double small = tm_law_stiffest_within_Pa(&m, false, 0.01), all = tm_law_stiffest_Pa(&m, false);
        const double linear = tm_material_stiffest_Pa(&m);
        double worst = 0, least = 0.1, bound = 0;
        bound = tm_law_stiffest_within_Pa(&m, false, 0.1);
        assert_true(tm_law_needs_fibre((tm_law_kind)law) || small < 1.15 * linear);
        assert_true(bound <= all && small > 0.99 * linear);
        tm_mesh *mesh;
        static const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
        fix_ok(fix_one_tet(corner, &mesh, &error), &error);
        tm_pool pool = {0};
        tm_hyperelastic h;
        const uint8_t alive = 1;
        const int32_t own = 0;
        double fibre[3] = {1, 0, 0}, best[12] = {0};
        const tm_material_field field = {.mesh = mesh,
                                         .alive = &alive,
                                         .material = &m,
                                         .region_material = &own,
                                         .material_count = 1,
                                         .fibre = fibre};
        assert_true(tm_hyperelastic_take(&h, &pool, &field));
        for (int k = 0; k < 1500; k++) {
            double u[12], A[81], x[9], y[9], strain2, length = 0;
            const double size = k < 500 ? 0.1 : 0.02;
            for (int i = 0; i < 12; i++) u[i] = (k < 500 ? 0 : best[i]) + size * fix_signed(&random);
            tm_hyper_green_choose(true)(&h, 0, 1, u, &strain2);
            if (strain2 > least * least) continue;
            tm_hyperelastic_hessian(&h, 0, u, A);
            for (int i = 0; i < 9; i++) x[i] = fix_signed(&random);
            for (int turn = 0; turn < 40; turn++) {
                length = 0;
                for (int i = 0; i < 9; i++) {
                    y[i] = 0;
                    for (int j = 0; j < 9; j++) y[i] += A[9 * i + j] * x[j];
                    length += y[i] * y[i];
                }
                for (int i = 0; i < 9; i++) x[i] = y[i] / sqrt(length);
            }
            const double a = sqrt(length) / mesh->volume_m3[0];
            if (a > worst) worst = a, memcpy(best, u, sizeof best);
        }
        print_message("%s: small %.2f, to 0.1 %.2f, all %.2f of the linear law; reached %.2f of that to 0.1\n",
                      tm_law_name(law), small / linear, bound / linear, all / linear, worst / bound);
        assert_true(worst <= bound && worst > 0.8 * bound);
        tm_pool_release(&pool);
        tm_mesh_destroy(mesh);
    }
}

static void refusals_say_why(void **state) {
    (void)state;
    fix_random random = {1};
    tm_error error;
    tm_mesh *mesh = fix_block((int[]){2, 2, 2}, (double[]){0.01, 0.01, 0.01}, 0, &random);
    tm_material m = exponential(true);
    for (int linear = 0; linear < 2; linear++) {
        if (linear) fix_ok(tm_material_young(5e3, 0.4, &m, &error), &error);
        tm_tissue *tissue = fix_tissue(mesh, &m, (double[]){1, 0, 0}, TM_DOUBLE, false);
        tm_world *world = fix_world(tissue, true);
        const double dt_s = tm_world_step_s(world);
        assert_int_equal(tm_world_adapt(world, (linear ? 2 : 100) * dt_s, &error),
                         linear ? TM_ERR_EXCLUDED : TM_ERR_STEP);
        assert_non_null(strstr(error.message, linear ? "needs a nonlinear law" : "guaranteed for strains up to 0.1"));
        assert_true(tm_world_step_s(world) == dt_s);
        tm_world_destroy(world);
        tm_tissue_destroy(tissue);
    }
    tm_mesh_destroy(mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(deep_tissue_takes_short_steps_only_while_deep),
        cmocka_unit_test(has_the_same_bits_by_threads_and_snapshots),
        cmocka_unit_test(a_failed_call_is_rolled_back),
        cmocka_unit_test(the_bound_by_strain_holds),
        cmocka_unit_test(refusals_say_why),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
