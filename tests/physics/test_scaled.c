/* Selective mass scaling: the requested step is guaranteed, before and after any cut; mass is added only where
 * needed; weight, equilibrium and the momentum account stay. */
#include "../cut_check.h"
#include "tensormass/energy.h"

typedef struct scene {
    tm_mesh *mesh;
    tm_material material;
    tm_tissue_def def;
    tm_tissue *tissue;
    tm_world *world;
    uint8_t *fixed;
} scene;

/* A jittered block: its flattest tetrahedra require a shorter step than the others. Fixed at x = 0. */
static scene make(double step_s, double share, bool cuttable, tm_precision precision) {
    fix_random random = {41};
    scene s = {.mesh = fix_block((int[3]){7, 5, 4}, (double[3]){0.07, 0.05, 0.04}, 0.3, &random)};
    tm_error error;
    fix_ok(tm_material_young(1e4, 0.45, &s.material, &error), &error);
    s.material.damping_1_s = 20;
    s.def = tm_tissue_def_default();
    s.def.mesh = s.mesh, s.def.material_count = 1, s.def.form = TM_FORCE_PLAIN, s.def.precision = precision;
    s.def.cuttable = cuttable, s.def.scaled_step_s = step_s, s.def.scaled_share = share;
    s.fixed = calloc(3, (size_t)s.mesh->vertex_count);
    memset(s.fixed, 1, 90);
    return s;
}

static void start(scene *s, double step_s) {
    tm_error error;
    s->def.material = &s->material;
    fix_ok(tm_tissue_create(&s->def, &s->tissue, &error), &error);
    tm_world_def def = tm_world_def_default();
    def.tissue = s->tissue, def.dt_s = step_s;
    fix_ok(tm_world_create(&def, &s->world, &error), &error);
    const double zero[90] = {0};
    int32_t dof[90];
    for (int i = 0; i < 90; i++) dof[i] = i; /* the 30 vertices at x = 0 */
    tm_support_def support = tm_support_def_default();
    support.count = 90, support.dof = dof, support.value_m = zero;
    fix_ok(tm_stage_support(s->world, &support, &error), &error);
    fix_ok(tm_stage_gravity(s->world, (const double[3]){0, 0, -9.81}, &error), &error);
}

static void stop(scene *s) {
    tm_world_destroy(s->world);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
    free(s->fixed);
    assert_int_equal(tm_memory_in_use(), 0);
}

/* Irons' bound, which cuttable tissue must use. */
static double even_step(void) {
    scene s = make(0, 0, true, TM_DOUBLE);
    start(&s, 0);
    const double step_s = tm_critical_step_guaranteed(s.tissue, NULL);
    tm_mass_scaling m;
    assert_false(tm_tissue_mass_scaling(s.tissue, &m));
    assert_true(m.added_kg == 0 && m.vertices == 0 && m.physical_kg > 0);
    assert_ptr_equal(tm_tissue_physical_mass_kg(s.tissue), tm_tissue_mass_kg(s.tissue));
    stop(&s);
    return step_s;
}

static void the_step_is_guaranteed_and_little_is_added(void **state) {
    (void)state;
    const double even = even_step(), times[4] = {1, 2.5, 2.8, 3}, most[4] = {0, 0, 0.1, 0.2};
    for (int i = 0; i < 4; i++) {
        scene s = make(times[i] * even, 1, true, TM_DOUBLE);
        start(&s, times[i] * even);
        tm_mass_scaling m;
        tm_error error;
        double estimate, own_Hz[3], scaled_Hz[3];
        assert_true(tm_tissue_mass_scaling(s.tissue, &m));
        fix_ok(tm_critical_step_estimate(s.tissue, NULL, 1e-8, 20000, &estimate, &error), &error);
        fix_ok(tm_mass_scaling_frequencies(s.tissue, s.fixed, own_Hz, scaled_Hz, &error), &error);
        print_message("  %g times the even step: %.3g of the mass added at %d vertices, at most %.3g times; sharp %.3g "
                      "times; z %.4g -> %.4g Hz\n",
                      times[i], m.added_kg / m.physical_kg, m.vertices, m.max_factor, estimate / even, own_Hz[2],
                      scaled_Hz[2]);
        assert_true(estimate >= times[i] * even && tm_critical_step_guaranteed(s.tissue, NULL) >= times[i] * even);
        assert_true(m.added_kg <= most[i] * m.physical_kg && (i < 2 || m.added_kg > 0));
        assert_true(m.physical_kg / (0.07 * 0.05 * 0.04 * s.material.density_kg_m3) - 1 < 1e-9);
        for (int c = 0; c < 3; c++) {
            const double ratio = scaled_Hz[c] / own_Hz[c];
            assert_true(ratio <= 1 && ratio > 1 / sqrt(1 + 3 * m.added_kg / m.physical_kg) - 1e-9);
        }
        assert_int_equal(tm_world_step(s.world, 400), TM_OK);
        stop(&s);
    }
}

/* Cut to the last tetrahedron: bits of a fresh build, no vertex gets heavier, and the estimated step of the
 * remainder is never shorter than requested. */
static void cuts_keep_the_step(void **state) {
    (void)state;
    const double step_s = 2.8 * even_step();
    for (int order = 0; order < 6; order++) { /* the last two with averaged dilatation, and shears */
        scene s = make(step_s, 1e9, true, order == 3 ? TM_SINGLE : TM_DOUBLE);
        s.def.strain_smoothing = order > 3, s.def.smoothed_shear_share = order == 5 ? 0.4 : 0;
        start(&s, step_s);
        fix_random random = {7 + (uint64_t)order};
        int32_t *list = malloc(sizeof(int32_t) * (size_t)s.mesh->tet_count);
        double *before = malloc(sizeof(double) * (size_t)s.mesh->vertex_count);
        for (int32_t t = 0; t < s.mesh->tet_count; t++) list[t] = t;
        cut_order_from(s.mesh, list, &random);
        for (int piece = 0; piece < 6; piece++) {
            const int32_t from = s.mesh->tet_count * piece / 6, to = s.mesh->tet_count * (piece + 1) / 6;
            double estimate;
            tm_error error;
            memcpy(before, tm_tissue_mass_kg(s.tissue), sizeof(double) * (size_t)s.mesh->vertex_count);
            tm_cut_remove(s.tissue, list + from, to - from - (piece == 5), NULL, 0);
            cut_same_bits(s.tissue, &s.def);
            for (int32_t v = 0; v < s.mesh->vertex_count; v++) assert_true(tm_tissue_mass_kg(s.tissue)[v] <= before[v]);
            assert_int_equal(tm_world_step(s.world, 50), TM_OK);
            assert_true(tm_critical_step_guaranteed(s.tissue, NULL) >= step_s);
            if (tm_tissue_alive_count(s.tissue) == 0) break;
            fix_ok(tm_critical_step_estimate(s.tissue, NULL, 1e-6, 20000, &estimate, &error), &error);
            assert_true(estimate >= step_s);
        }
        free(list), free(before);
        stop(&s);
    }
}

static void rest_and_weight_are_untouched(void **state) {
    (void)state;
    const double step_s = 2.8 * even_step();
    scene plain = make(0, 0, true, TM_DOUBLE), heavy = make(step_s, 1, true, TM_DOUBLE);
    start(&plain, 0), start(&heavy, step_s);
    const size_t n = 3 * (size_t)plain.mesh->vertex_count;
    assert_memory_equal(tm_tissue_physical_mass_kg(heavy.tissue), tm_tissue_mass_kg(plain.tissue),
                        n / 3 * sizeof(double));
    assert_memory_equal(tm_tissue_damping_kg_s(heavy.tissue), tm_tissue_damping_kg_s(plain.tissue),
                        n / 3 * sizeof(double));
    tm_error error;
    tm_settle_def settle = tm_settle_def_default();
    fix_ok(tm_world_settle(plain.world, &settle, NULL, &error), &error);
    fix_ok(tm_world_settle(heavy.world, &settle, NULL, &error), &error);
    const double *a = tm_world_state(plain.world)->u_m, *b = tm_world_state(heavy.world)->u_m;
    for (size_t i = 0; i < n; i++) assert_true(fabs(a[i] - b[i]) < 1e-8 * fix_largest(a, (int32_t)n));
    tm_world_destroy(plain.world), tm_tissue_destroy(plain.tissue), tm_mesh_destroy(plain.mesh), free(plain.fixed);
    stop(&heavy);
}

/* Oscillates under gravity and is cut: the energy account stays closed. */
static void the_energy_account_closes(void **state) {
    (void)state;
    const double step_s = 2.8 * even_step();
    scene s = make(step_s, 1, true, TM_DOUBLE);
    start(&s, step_s);
    tm_error error;
    tm_energy e;
    fix_ok(tm_stage_energy(s.world, &error), &error);
    fix_random random = {3};
    for (int cut = 0; cut < 5; cut++) {
        assert_int_equal(tm_world_step(s.world, 100), TM_OK);
        const int32_t tet = (int32_t)(fix_uniform(&random) * s.mesh->tet_count);
        tm_cut_remove(s.tissue, &tet, 1, NULL, 0);
    }
    assert_int_equal(tm_world_step(s.world, 100), TM_OK);
    fix_ok(tm_world_energy(s.world, &e, &error), &error);
    print_message("  residual %.3g, moved %.3g of gravity's %.3g J, %.3g J cut away\n", e.residual_J, e.state_change_J,
                  e.gravity_J, e.cut_J);
    assert_true(e.gravity_J > 0 && e.cut_J != 0 && fabs(e.residual_J) < 1e-9 * e.gravity_J);
    assert_true(fabs(e.state_change_J) < 1e-9 * e.gravity_J);
    stop(&s);
}

static void impossible_mass_scaling_is_rejected(void **state) {
    (void)state;
    const double even = even_step();
    scene s = make(6 * even, 0.2, true, TM_DOUBLE);
    tm_error error;
    s.def.material = &s.material;
    assert_int_equal(tm_tissue_create(&s.def, &s.tissue, &error), TM_ERR_LIMIT);
    assert_non_null(strstr(error.message, "physical mass"));
    assert_in_range(error.entity, 0, s.mesh->vertex_count - 1);
    s.def.scaled_share = 1e9;
    s.def.scaled_step_s = -1;
    assert_int_equal(tm_tissue_create(&s.def, &s.tissue, &error), TM_ERR_ARGUMENT);
    s.def.scaled_step_s = NAN;
    assert_int_equal(tm_tissue_create(&s.def, &s.tissue, &error), TM_ERR_ARGUMENT);
    s.def.scaled_step_s = even;
    double *extra = calloc((size_t)s.mesh->vertex_count, sizeof *extra);
    s.def.extra_mass_kg = extra;
    assert_int_equal(tm_tissue_create(&s.def, &s.tissue, &error), TM_ERR_EXCLUDED);
    free(extra);
    s.def.extra_mass_kg = NULL;
    start(&s, even);
    double own_Hz[3], scaled_Hz[3]; /* no supports */
    memset(s.fixed, 0, 90);
    assert_int_equal(tm_mass_scaling_frequencies(s.tissue, s.fixed, own_Hz, scaled_Hz, &error), TM_ERR_CONVERGENCE);
    stop(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_step_is_guaranteed_and_little_is_added), cmocka_unit_test(cuts_keep_the_step),
        cmocka_unit_test(rest_and_weight_are_untouched), cmocka_unit_test(the_energy_account_closes),
        cmocka_unit_test(impossible_mass_scaling_is_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
