/* Random cuts with self-contact: lips that are thrown about do not cross and gain no energy. 10,000 cuts in the long
 * form. */
#include "../fixture.h"
#include "../long.h"

#include "apps/common/block.h"

enum { CUTS_A_BLOCK = 20 };

typedef struct body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_touching *touching;
} body;

/* Edges of 2 mm, base fixed. */
static body make(void) {
    const int32_t cells[3] = {7, 7, 4};
    const double size_m[3] = {0.014, 0.014, 0.008};
    app_block block;
    body b = {0};
    tm_error error;
    assert_true(app_block_build(&block, cells, size_m));
    fix_ok(app_block_mesh(&block, NULL, &b.mesh, &error), &error);
    app_block_free(&block);
    tm_material material;
    fix_ok(tm_material_young(3000, 0.4, &material, &error), &error);
    material.damping_1_s = 20;
    b.tissue = fix_tissue(b.mesh, &material, NULL, TM_DOUBLE, true);
    tm_world_def world = tm_world_def_default();
    world.tissue = b.tissue;
    fix_ok(tm_world_create(&world, &b.world, &error), &error);
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)b.mesh->vertex_count), count = 0;
    double *zero = calloc((size_t)b.mesh->vertex_count * 3, sizeof *zero);
    for (int32_t v = 0; v < b.mesh->vertex_count; v++)
        for (int c = 0; c < 3 && b.mesh->rest_m[3 * v + 2] < 1e-9; c++) dof[count++] = 3 * v + c;
    tm_support_def support = tm_support_def_default();
    support.count = count, support.dof = dof, support.value_m = zero;
    fix_ok(tm_stage_support(b.world, &support, &error), &error);
    free(dof), free(zero);
    tm_touching_def touch = tm_touching_def_default();
    touch.thickness_m = 0.3e-3, touch.mu_static = touch.mu_kinetic = 0.1;
    fix_ok(tm_stage_touch(b.world, &touch, &b.touching, &error), &error);
    fix_ok(tm_stage_energy(b.world, &error), &error);
    return b;
}

static double kinetic_J(const body *b) {
    const tm_state *s = tm_world_state(b->world);
    double sum = 0;
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++) {
        const double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        sum += 0.5 * tm_tissue_mass_kg(b->tissue)[i / 3] * v * v;
    }
    return sum;
}

/* Throws the part above a random height sideways and down, at up to 0.6 m/s. Returns the added energy, J. */
static double throw_top(body *b, fix_random *random) {
    tm_state *s = tm_world_state(b->world);
    const double before_J = kinetic_J(b);
    const double above_m = 0.008 * fix_uniform(random),
                 v[3] = {0.6 * fix_signed(random), 0.6 * fix_signed(random), -0.3 * fix_uniform(random)};
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++)
        if (b->mesh->rest_m[i / 3 * 3 + 2] > above_m && tm_tissue_mass_kg(b->tissue)[i / 3] > 0)
            s->u_prev_m[i] -= v[i % 3] * s->dt_s;
    return fmax(kinetic_J(b) - before_J, 0);
}

static void lips_of_random_cuts_do_not_cross_and_gain_no_energy(void **state) {
    (void)state;
    const int blocks = test_is_long() ? 500 : test_is_sanitized() ? 1 : 2;
    fix_random random = {5};
    int32_t cuts = 0, rows = 0;
    double deepest_m = 0, worst = 0;
    for (int k = 0; k < blocks; k++) {
        body b = make();
        tm_error error;
        tm_energy e = {0};
        double most_J = 0, put_in_J = 0;
        for (int i = 0; i < CUTS_A_BLOCK; i++, cuts++) {
            const int32_t v = (int32_t)(fix_uniform(&random) * b.mesh->vertex_count);
            const int32_t *around = b.mesh->vertex_tet + b.mesh->vertex_tet_begin[v];
            const int32_t count = b.mesh->vertex_tet_begin[v + 1] - b.mesh->vertex_tet_begin[v];
            tm_cut_remove(b.tissue, around, count < 8 ? count : 8, NULL, 0);
            if (i % 3 == 2) put_in_J += throw_top(&b, &random);
            for (int n = 0; n < 5; n++) {
                assert_int_equal(tm_world_step(b.world, 5), TM_OK);
                fix_ok(tm_world_energy(b.world, &e, &error), &error);
                most_J = fmax(most_J, e.touch_J + e.touch_stored_J);
                const tm_touching_report r = tm_touching_get_report(b.touching);
                deepest_m = fmax(deepest_m, r.deepest_m), rows += r.rows;
                assert_false(r.overflowed);
            }
        }
        worst = fmax(worst, most_J / put_in_J);
        tm_world_destroy(b.world);
        tm_tissue_destroy(b.tissue);
        tm_mesh_destroy(b.mesh);
    }
    printf("%d cuts, %d rows: deepest overlap %.3g mm, energy made at most %.2g %% of what was put in\n", cuts, rows,
           1e3 * deepest_m, 100 * worst);
    assert_true(rows > 0 && deepest_m <= 0.05e-3 && worst <= 0.01);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(lips_of_random_cuts_do_not_cross_and_gain_no_energy)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
