/* Patches of tissue that rests on other tissue: a plate over a block, pressed from above. Stiffness and patch against
 * settled forces of the complete simulation, and against those of the plate alone. */
#include "kit.h"

#include "patch/patch_internal.h"
#include "tensormass/touch.h"

#include "../long.h"
#include "apps/common/block.h"

static const double RADIUS_M = 0.004, TOP_M = 0.0283;

typedef struct stacked {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_touching *touching;
    tm_contact *contact;
    tm_compliance_factor *factor;
    tm_patch_builder *builder;
    tm_patch_solver *solver;
    tm_patch patch;
} stacked;

static void add_block(const int32_t cells[3], const double size_m[3], const double at_m[3], int32_t body,
                      double *vertex, int32_t *tet, int32_t *of_body, int32_t *v, int32_t *t) {
    app_block block;
    assert_true(app_block_build(&block, cells, size_m));
    for (int32_t i = 0; i < 3 * block.vertex_count; i++) vertex[3 * *v + i] = block.vertex_m[i] + at_m[i % 3];
    for (int32_t i = 0; i < 4 * block.tet_count; i++) tet[4 * *t + i] = block.tet[i] + *v;
    for (int32_t i = 0; i < block.tet_count; i++) of_body[*t + i] = body;
    *v += block.vertex_count, *t += block.tet_count;
    app_block_free(&block);
}

typedef enum plate { HELD, LIES, FLOATS } plate;

/* The block is held at its base; the plate along both ends, or it lies on the block, or is 3 mm above it. */
static void make_mesh(stacked *s, double mu, plate is) {
    enum { VERTICES = 400, TETS = 1200 };
    double vertex[3 * VERTICES];
    int32_t tet[4 * TETS], body[TETS], v = 0, t = 0;
    tm_error error;
    add_block((int32_t[]){6, 6, 3}, (double[]){0.05, 0.05, 0.02}, (double[]){0.002, 0, 0}, 0, vertex, tet, body, &v,
              &t);
    add_block((int32_t[]){7, 5, 2}, (double[]){0.056, 0.04, 0.008},
              (double[]){0, 0.005, is == FLOATS ? 0.0233 : 0.0203}, 1, vertex, tet, body, &v, &t);
    assert_true(v <= VERTICES && t <= TETS);
    tm_mesh_def mesh = tm_mesh_def_default();
    mesh.vertex_count = v, mesh.vertex_m = vertex, mesh.tet_count = t, mesh.tet = tet;
    fix_ok(tm_mesh_create(&mesh, &s->mesh, &error), &error);
    tm_material m = kit_material(5e3, 0.4);
    m.damping_1_s = 60;
    s->tissue = fix_tissue(s->mesh, &m, NULL, TM_DOUBLE, false);
    s->world = fix_world(s->tissue, true);
    uint8_t *fixed = calloc(3 * (size_t)v, 1);
    for (int32_t d = 0; d < 3 * v; d++)
        fixed[d] =
            vertex[d / 3 * 3 + 2] < 1e-9 || (is == HELD && (vertex[d / 3 * 3] < 1e-9 || vertex[d / 3 * 3] > 0.0559));
    kit_support(s->world, fixed, NULL);
    const tm_instrument_def tool = {.mode = TM_TOOL_PROBE,
                                    .radius_m = RADIUS_M,
                                    .contact_length_m = 0.1,
                                    .trocar_m = {0.03, 0.025, 0.25},
                                    .pose = {.tip_m = {0.034, 0.026, TOP_M + 0.006}, .active = true}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    fix_ok(tm_stage_contact(s->world, &contact, &s->contact, &error), &error);
    tm_touching_def touch = tm_touching_def_default();
    touch.body_count = 2, touch.tet_body = body, touch.mu_static = touch.mu_kinetic = mu;
    fix_ok(tm_stage_touch(s->world, &touch, &s->touching, &error), &error);
    tm_compliance_factor_def factor = tm_compliance_factor_def_default();
    factor.tissue = s->tissue, factor.fixed = fixed;
    fix_ok(tm_compliance_factor_create(&factor, &s->factor, &error), &error);
    const tm_compliance_source source = tm_compliance_factor_source(s->factor);
    tm_patch_def patch = tm_patch_def_default();
    patch.source = &source;
    fix_ok(tm_stage_patch(s->world, s->contact, &patch, &s->builder, &error), &error);
    fix_ok(tm_patch_solver_create(&s->solver, &error), &error);
    free(fixed);
}

static void destroy(stacked *s) {
    tm_patch_solver_destroy(s->solver);
    tm_world_destroy(s->world);
    tm_compliance_factor_destroy(s->factor);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
}

static void move_to(stacked *s, const double tip_m[3], double seconds) {
    tm_tool_pose at = {.tip_m = {tip_m[0], tip_m[1], tip_m[2]}, .active = true};
    const int32_t substeps = 1 + (int32_t)(seconds / tm_world_step_s(s->world));
    tm_contact_begin_frame(s->contact, substeps, substeps);
    tm_contact_set_target(s->contact, 0, &at, substeps);
    assert_int_equal(tm_world_step(s->world, substeps), TM_OK);
}

/* Returns the force once all has come to rest. */
static void rest_at(stacked *s, const double tip_m[3], double force_N[3]) {
    move_to(s, tip_m, 0.1);
    move_to(s, tip_m, 1);
    memcpy(force_N, tm_contact_reaction(s->contact, 0).force_N, 3 * sizeof(double));
}

static double norm(const double *a, int n) {
    double sum = 0;
    for (int i = 0; i < n; i++) sum += a[i] * a[i];
    return sqrt(sum);
}

static double off(const double *a, const double *b, int n) {
    double d[9];
    for (int i = 0; i < n; i++) d[i] = a[i] - b[i];
    return norm(d, n) / norm(b, n);
}

/* Differences of forces at rest, by 0.1 mm to both sides. */
static void measure(stacked *s, const double tip_m[3], double K[9]) {
    for (int c = 0; c < 3; c++) {
        double force[2][3];
        for (int side = 0; side < 2; side++) {
            double at[3] = {tip_m[0], tip_m[1], tip_m[2]};
            at[c] += side ? 1e-4 : -1e-4;
            rest_at(s, at, force[side]);
        }
        for (int i = 0; i < 3; i++) K[3 * i + c] = (force[1][i] - force[0][i]) / 2e-4;
    }
}

static void against_rest(double mu, double most_stiffness, double most_force) {
    static const double moves[4][3] = {{0, 0, -5e-4}, {0, 0, 5e-4}, {5e-4, 0, 0}, {-3e-4, 4e-4, -3e-4}};
    const double tip_m[3] = {0.034, 0.026, TOP_M + RADIUS_M - 0.004};
    stacked s = {0};
    double K[9], force[3], alone[9], worst = 0, worst_alone = 0, hold = 0, truth[4][3];
    make_mesh(&s, mu, HELD);
    rest_at(&s, tip_m, force);
    measure(&s, tip_m, K);
    for (int k = 0; k < 4; k++) {
        double at[3];
        for (int c = 0; c < 3; c++) at[c] = tip_m[c] + moves[k][c];
        rest_at(&s, at, truth[k]);
    }
    rest_at(&s, tip_m, force);
    tm_patch_behind *behind = s.builder->behind;
    for (int coupled = 0; coupled < 2; coupled++) {
        s.builder->behind = coupled ? behind : NULL;
        s.builder->behind_count = 0;
        const bool made = tm_patch_compute(s.builder, 0, &s.patch);
        assert_true(made || !coupled); /* the plate alone may have another equilibrium */
        if (!coupled) memcpy(alone, tm_contact_reaction(s.contact, 0).stiffness_N_m, sizeof alone);
        for (int k = 0; k < 4; k++) {
            double at[3], said[3];
            for (int c = 0; c < 3; c++) at[c] = tip_m[c] + moves[k][c];
            tm_patch_force(s.solver, &s.patch, at, said, NULL);
            double *most = coupled ? &worst : &worst_alone;
            *most = fmax(*most, off(said, truth[k], 3) * norm(truth[k], 3) / norm(force, 3));
            hold = fmax(hold, off(force, truth[k], 3) * norm(truth[k], 3) / norm(force, 3));
        }
    }
    const double *said = tm_contact_reaction(s.contact, 0).stiffness_N_m;
    printf(
        "friction %.1f, %d rows: %.3f N, %.1f N/m; stiffness off by %.2f %%, of the plate alone %.1f %%; moved by 0.5 mm: "
        "patch off by %.3f %%, of the plate alone %.2f %%, hold %.1f %%\n",
        mu, tm_touching_get_report(s.touching).rows, norm(force, 3), -K[8], 100 * off(said, K, 9),
        100 * off(alone, K, 9), 100 * worst, 100 * worst_alone, 100 * hold);
    assert_true(off(said, K, 9) < most_stiffness && worst < most_force);
    assert_true(off(alone, K, 9) > 3 * most_stiffness && worst_alone > 3 * worst); /* or it proves nothing */
    destroy(&s);
}

static void a_plate_that_nothing_holds_has_no_patch(void **state) {
    (void)state;
    stacked s = {0};
    double force[3];
    make_mesh(&s, 0.5, FLOATS);
    rest_at(&s, (double[]){0.03, 0.025, TOP_M + 0.003 + RADIUS_M + 1e-3}, force);
    assert_false(tm_patch_compute(s.builder, 0, &s.patch));
    destroy(&s);
}

static void a_plate_held_by_contact_alone_has_a_patch(void **state) {
    (void)state;
    static const double moves[3][3] = {{0, 0, -5e-4}, {0, 0, 3e-4}, {3e-4, 0, -2e-4}};
    const int count = test_is_sanitized() ? 1 : 3;
    const double tip_m[3] = {0.03, 0.025, TOP_M + RADIUS_M - 0.004};
    stacked s = {0};
    double K[9], force[3], worst = 0, hold = 0, truth[3][3];
    make_mesh(&s, 0.5, LIES);
    rest_at(&s, tip_m, force);
    measure(&s, tip_m, K);
    for (int k = 0; k < count; k++) {
        double at[3];
        for (int c = 0; c < 3; c++) at[c] = tip_m[c] + moves[k][c];
        rest_at(&s, at, truth[k]);
        rest_at(&s, tip_m, force);
    }
    assert_true(tm_patch_compute(s.builder, 0, &s.patch));
    for (int k = 0; k < count; k++) {
        double at[3], said[3];
        for (int c = 0; c < 3; c++) at[c] = tip_m[c] + moves[k][c];
        tm_patch_force(s.solver, &s.patch, at, said, NULL);
        worst = fmax(worst, off(said, truth[k], 3) * norm(truth[k], 3) / norm(force, 3));
        hold = fmax(hold, off(force, truth[k], 3) * norm(truth[k], 3) / norm(force, 3));
    }
    const double *said = tm_contact_reaction(s.contact, 0).stiffness_N_m;
    printf("held by %d rows alone: %.3f N, %.1f N/m; stiffness off by %.2f %%; patch off by %.3f %%, hold %.1f %%\n",
           tm_touching_get_report(s.touching).rows, norm(force, 3), -K[8], 100 * off(said, K, 9), 100 * worst,
           100 * hold);
    assert_true(off(said, K, 9) < 0.04 && worst < 0.005 && hold > 0.05);
    destroy(&s);
}

static void pressing_a_plate_feels_the_block_behind(void **state) {
    (void)state;
    against_rest(0, 0.08, 0.025);
    against_rest(0.3, 0.01, 0.003);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(pressing_a_plate_feels_the_block_behind),
                                       cmocka_unit_test(a_plate_that_nothing_holds_has_no_patch),
                                       cmocka_unit_test(a_plate_held_by_contact_alone_has_a_patch)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
