/* Settling of tissue that rotates, with `rotation` and every nonlinear law: bars whose ends are twisted and bent by
 * 30 to 180 degrees in one call, against small steps; buckling bars; reports of unreliable shapes; bounded work if
 * no equilibrium exists. */
#include "../fixture.h"

#include <string.h>

#include "tensormass/contact.h"
#include "tensormass/rotation.h"

typedef struct bar {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n, count, *dof; /* of both ends, z = 0 and the far one */
    double size_m[3];
} bar;

/* The last five: nonlinear laws of the material, with fibres along the bar if the law has them. */
typedef enum law { LINEAR, TURNING, TURNING_VOLUME, NEO, GREEN, MOONEY, FUNG, HOLZAPFEL, LAWS } law;

static void set_law(law kind, tm_material *m) {
    static const double constant[LAWS][TM_LAW_CONSTANTS] = {
        [GREEN] = {1}, [MOONEY] = {0.1}, [FUNG] = {1e4}, [HOLZAPFEL] = {2e3, 0.5, 0.1}};
    static const tm_law_kind named[LAWS] = {[NEO] = TM_LAW_NEO_HOOKE,
                                            [GREEN] = TM_LAW_ST_VENANT_KIRCHHOFF,
                                            [MOONEY] = TM_LAW_MOONEY_RIVLIN,
                                            [FUNG] = TM_LAW_FUNG,
                                            [HOLZAPFEL] = TM_LAW_HOLZAPFEL};
    tm_error error;
    if (kind == GREEN || kind == FUNG) m->dmu_Pa = m->mu_Pa, m->beta_Pa = m->mu_Pa;
    if (kind >= NEO) fix_ok(tm_material_set_law(m, named[kind], constant[kind], 0, &error), &error);
}

/* Supports of the far end: along z it is free; or at every second vertex, which no edge joins to others. */
typedef enum far_end { WHOLE, SLIDES, SPOTS } far_end;

static bool is_held(const bar *b, int32_t dof, far_end how, const int cells[3]) {
    const double *x = b->mesh->rest_m + dof / 3 * 3;
    if (x[2] == 0) return true;
    if (x[2] < b->size_m[2] * (1 - 1e-9) || (how == SLIDES && dof % 3 == 2)) return false;
    const int i = (int)lround(x[0] / b->size_m[0] * cells[0]), j = (int)lround(x[1] / b->size_m[1] * cells[1]);
    return how != SPOTS || (i % 2 == 0 && j % 2 == 0);
}

static bar make_of(law kind, double poisson, const int cells[3], const double size_m[3], far_end how) {
    bar b = {0};
    tm_material m;
    tm_error error;
    fix_random random = {1};
    b.mesh = fix_block(cells, size_m, 0, &random);
    b.n = 3 * b.mesh->vertex_count;
    memcpy(b.size_m, size_m, sizeof b.size_m);
    fix_ok(tm_material_young(5e3, poisson, &m, &error), &error);
    set_law(kind, &m);
    double *fibre = fix_fibres(b.mesh, (double[]){0, 0, 1});
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b.mesh, def.material_count = 1, def.material = &m, def.fibre = kind >= NEO ? fibre : NULL;
    def.rotation = kind == TURNING || kind == TURNING_VOLUME ? TM_ROTATION_THRESHOLD : 0;
    def.strain_smoothing = kind == TURNING_VOLUME, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &b.tissue, &error), &error);
    free(fibre);
    b.world = fix_world(b.tissue, true);
    if (def.rotation > 0) fix_ok(tm_stage_rotation(b.world, NULL, &error), &error);
    b.dof = malloc(sizeof(int32_t) * (size_t)b.n);
    for (int32_t i = 0; i < b.n; i++)
        if (is_held(&b, i, how, cells)) b.dof[b.count++] = i;
    double *zero = calloc((size_t)b.count, sizeof *zero);
    tm_support_def support = tm_support_def_default();
    support.count = b.count, support.dof = b.dof, support.value_m = zero;
    fix_ok(tm_stage_support(b.world, &support, &error), &error);
    free(zero);
    return b;
}

static bar make(law kind, double poisson, const int cells[3], const double size_m[3]) {
    return make_of(kind, poisson, cells, size_m, WHOLE);
}

static bar usual(law kind) { return make(kind, 0.45, (const int[]){2, 2, 8}, (const double[]){0.02, 0.02, 0.08}); }

static void destroy(bar *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->dof);
}

/* Sets y = to + R (x - from), R about `axis` by `angle`. */
typedef struct motion {
    double axis[3], angle, from[3], to[3];
} motion;

static void moved(const motion *m, const double x[3], double y[3]) {
    const double *a = m->axis, size = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    const double c = cos(m->angle), s = sin(m->angle);
    double d[3], along = 0;
    for (int i = 0; i < 3; i++) d[i] = x[i] - m->from[i], along += a[i] / size * d[i];
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        y[i] = m->to[i] + c * d[i] + s * (a[j] * d[k] - a[k] * d[j]) / size + (1 - c) * along * a[i] / size;
    }
}

/* Makes the supports of one end, or of both. */
static void hold(const bar *b, const motion *m, bool near, bool far) {
    for (int32_t i = 0; i < b->count; i++) {
        const double *x = b->mesh->rest_m + b->dof[i] / 3 * 3;
        double y[3];
        if (!(x[2] > 0 ? far : near)) continue;
        moved(m, x, y);
        tm_support_move(b->world, i, y[b->dof[i] % 3] - x[b->dof[i] % 3]);
    }
}

typedef enum way { TURNED, TWISTED, BENT, WAYS } way;

static void lead(const bar *b, way how, double degrees) {
    const double angle = degrees * M_PI / 180, x = b->size_m[0] / 2, y = b->size_m[1] / 2, L = b->size_m[2];
    const motion turned = {{1, 2, 0.5}, angle, {x, y, L / 2}, {x, y, L / 2}};
    const motion twisted = {{0, 0, 1}, angle, {x, y, L}, {x, y, L}};
    const motion bent = {{-1, 0, 0}, angle, {x, y, L}, {x, y + L / angle * (1 - cos(angle)), L / angle * sin(angle)}};
    hold(b, how == TURNED ? &turned : how == TWISTED ? &twisted : &bent, how == TURNED, true);
}

static tm_settle_result settle(const bar *b, double tolerance) {
    tm_settle_def def = tm_settle_def_default();
    tm_settle_result result;
    tm_error error;
    def.tolerance = tolerance;
    fix_ok(tm_world_settle(b->world, &def, &result, &error), &error);
    assert_true(result.residual <= tolerance);
    return result;
}

/* With the default tolerance no force is left, and every vertex is where the rotation moves it. */
static void ends_rotated_together_rotate_the_bar(void **state) {
    (void)state;
    for (law kind = TURNING; kind < LAWS; kind++)
        for (int degrees = 30; degrees <= 180; degrees += kind < NEO ? 30 : degrees < 90 ? 60 : 90) {
            bar b = usual(kind);
            const double mid[3] = {b.size_m[0] / 2, b.size_m[1] / 2, b.size_m[2] / 2};
            motion m = {{1, 2, 0.5}, degrees * M_PI / 180, {mid[0], mid[1], mid[2]}, {mid[0], mid[1], mid[2]}};
            lead(&b, TURNED, degrees);
            const tm_settle_result r = settle(&b, tm_settle_def_default().tolerance);
            assert_true(fabs(r.energy_J) < 1e-12 && fabs(r.deformation.min_det - 1) < 1e-9);
            for (int32_t v = 0; v < b.n / 3; v++) {
                const double *x = b.mesh->rest_m + 3 * v, *u = tm_world_state(b.world)->u_m + 3 * v;
                double y[3];
                moved(&m, x, y);
                for (int i = 0; i < 3; i++) assert_true(fabs(x[i] + u[i] - y[i]) < 1e-9);
            }
            destroy(&b);
        }
}

/* One call, compared with steps of 15 degrees: no more energy, and no inverted tetrahedra. Laws in steps of 45:
 * where the bar's inner side is bent by 40 % there are several equilibria (Mooney-Rivlin: 0.6 % apart, each a
 * minimum). */
static void one_call_finds_the_equilibrium_of_small_steps(void **state) {
    (void)state;
    for (law kind = TURNING; kind < LAWS; kind++)
        for (way how = TWISTED; how <= BENT; how++) {
            bar led = usual(kind);
            const int step = kind < NEO ? 15 : 45;
            const double more = kind < NEO ? 1e-5 : 0.01;
            for (int degrees = step; degrees <= 180; degrees += step) {
                lead(&led, how, degrees);
                const tm_settle_result slowly = settle(&led, 1e-8);
                if (degrees % (kind < NEO ? 30 : 90)) continue;
                bar b = usual(kind);
                lead(&b, how, degrees);
                const tm_settle_result r = settle(&b, 1e-9);
                assert_true(r.energy_J > 0 && r.energy_J < slowly.energy_J * (1 + more));
                assert_true(r.deformation.min_det > slowly.deformation.min_det - 0.01);
                assert_true(r.deformation.min_det > 0.1 && r.deformation.inverted == 0);
                if (degrees > 60) assert_true(r.load_steps > 1);
                destroy(&b);
            }
            destroy(&led);
        }
}

/* A twist of 150 or 180 degrees of a partly supported far end, against steps of ten. */
static void far_end_is_led(far_end how, int boxes) {
    const int cells[3] = {boxes, boxes, 4 * boxes};
    const double size_m[3] = {0.02, 0.02, 0.08};
    bar led = make_of(TURNING_VOLUME, 0.45, cells, size_m, how);
    for (int degrees = 10; degrees <= 180; degrees += 10) {
        lead(&led, TWISTED, degrees);
        const tm_settle_result slowly = settle(&led, 1e-6);
        if (degrees != 150 && degrees != 180) continue;
        bar b = make_of(TURNING_VOLUME, 0.45, cells, size_m, how);
        lead(&b, TWISTED, degrees);
        const tm_settle_result r = settle(&b, 1e-6);
        assert_true(r.energy_J < slowly.energy_J * (1 + 1e-5) && r.deformation.inverted == 0);
        destroy(&b);
    }
    destroy(&led);
}

static void sliding_ends_follow_the_rotation(void **state) {
    (void)state;
    far_end_is_led(SLIDES, 4);
}

/* Without a known rotation path, an increment that leaves the path of small steps is rolled back and halved. */
static void increments_off_the_path_are_halved(void **state) {
    (void)state;
    far_end_is_led(SPOTS, 2);
}

/* A bar of 20 x 20 x 80 mm: the straight path of its end passes through a point, and the stored energy is 0.00655 J. */
static void bar_twisted_by_half_a_turn_stores_the_right_energy(void **state) {
    (void)state;
    bar b = make(TURNING_VOLUME, 0.45, (const int[]){4, 4, 16}, (const double[]){0.02, 0.02, 0.08});
    lead(&b, TWISTED, 180);
    const tm_settle_result r = settle(&b, 1e-8);
    assert_true(fabs(r.energy_J - 0.0032735) < 1e-6 && fabs(r.deformation.min_det - 0.903) < 1e-3);
    destroy(&b);
}

/* Both ends are rotated by different angles: only the angle between them counts, in the shorter direction. */
static void ends_rotate_in_the_shorter_direction(void **state) {
    (void)state;
    bar both = usual(TURNING_VOLUME), one = usual(TURNING_VOLUME);
    const double x = 0.01, y = 0.01, L = 0.08;
    const motion near = {{0, 0, 1}, 0.9 * M_PI, {x, y, 0}, {x, y, 0}};
    const motion far = {{0, 0, 1}, -0.9 * M_PI, {x, y, L}, {x, y, L}};
    hold(&both, &near, true, false);
    hold(&both, &far, false, true);
    lead(&one, TWISTED, 36);
    const double stored_J = settle(&one, 1e-9).energy_J;
    assert_true(fabs(settle(&both, 1e-9).energy_J - stored_J) < 1e-6 * stored_J);
    destroy(&one);
    destroy(&both);
}

/* Pressed along its axis, it stays straight until it buckles; the straight shape is an equilibrium too, but no
 * minimum. */
static void a_slender_bar_buckles(void **state) {
    (void)state;
    for (int percent = 5; percent <= 10; percent += 5) {
        const double size_m[3] = {0.01, 0.01, 0.12}, c[3] = {0.005, 0.005, 0.12};
        bar b = make(TURNING_VOLUME, 0.3, (const int[]){2, 2, 24}, size_m);
        const motion m = {{0, 0, 1}, 0, {c[0], c[1], c[2]}, {c[0], c[1], c[2] * (1 - 0.01 * percent)}};
        hold(&b, &m, false, true);
        const double stored_J = settle(&b, 1e-9).energy_J;
        tm_state *s = tm_world_state(b.world);
        fix_random random = {3};
        for (int32_t i = 0; i < b.n; i++) s->u_m[i] = s->u_prev_m[i] = s->u_m[i] + 2e-4 * fix_signed(&random);
        assert_true(settle(&b, 1e-9).energy_J > stored_J * (1 - 1e-6));
        destroy(&b);
    }
}

/* With stages that are relaxed the same equilibrium is found: a tool exists, far away. */
static void supports_rotate_with_contact_too(void **state) {
    (void)state;
    for (way how = TURNED; how <= TWISTED; how++) {
        bar b = usual(TURNING), same = usual(TURNING);
        const tm_instrument_def tool = {.mode = TM_TOOL_PROBE,
                                        .radius_m = 0.0025,
                                        .contact_length_m = 0.05,
                                        .trocar_m = {0, 0, 1},
                                        .pose = {.tip_m = {0, 0, 0.9}, .active = true}};
        tm_contact_def def = tm_contact_def_default();
        def.instrument_count = 1, def.instrument = &tool;
        tm_contact *contact = NULL;
        tm_error error;
        fix_ok(tm_stage_contact(b.world, &def, &contact, &error), &error);
        lead(&b, how, how == TURNED ? 90 : 180);
        lead(&same, how, how == TURNED ? 90 : 180);
        const double alone_J = settle(&same, 1e-8).energy_J;
        const tm_settle_result r = settle(&b, 1e-6);
        assert_true(fabs(r.energy_J - alone_J) < 1e-6 * alone_J + 1e-9 && r.deformation.inverted == 0);
        destroy(&same);
        destroy(&b);
    }
}

/* Linear tissue: a translation gives equilibrium without force; a large rotation gives a warning with a remedy. */
static void linear_tissue_says_when_it_is_far_outside_its_range(void **state) {
    (void)state;
    bar b = usual(LINEAR);
    char sentence[TM_ERROR_MESSAGE_MAX];
    const motion away = {{0, 0, 1}, 0, {0, 0, 0}, {1, 2, 3}};
    hold(&b, &away, true, true);
    tm_settle_result r = settle(&b, tm_settle_def_default().tolerance);
    assert_true(fabs(r.deformation.min_det - 1) < 1e-9 && r.deformation.nonlinear_strain < 1e-15);
    assert_false(tm_tissue_check_deformation(b.tissue, &r.deformation, sentence));
    assert_int_equal(sentence[0], 0);
    lead(&b, TURNED, 10);
    r = settle(&b, 1e-9);
    assert_false(tm_tissue_check_deformation(b.tissue, &r.deformation, sentence));
    lead(&b, TURNED, 90);
    r = settle(&b, 1e-9);
    assert_true(r.deformation.nonlinear_share > 0.9);
    assert_true(tm_tissue_check_deformation(b.tissue, &r.deformation, sentence) && strstr(sentence, "'rotation'"));
    destroy(&b);
}

/* Pressed through itself. */
static void tetrahedra_inside_out_are_counted(void **state) {
    (void)state;
    bar b = usual(TURNING);
    char sentence[TM_ERROR_MESSAGE_MAX];
    const motion through = {{0, 0, 1}, 0, {0, 0, 0.08}, {0, 0, -0.02}};
    hold(&b, &through, false, true);
    const tm_settle_result r = settle(&b, 1e-6);
    assert_true(r.deformation.inverted > 0 && r.deformation.min_det <= 0);
    assert_true(tm_tissue_check_deformation(b.tissue, &r.deformation, sentence) && strstr(sentence, "inverted"));
    destroy(&b);
}

/* A block thrown about by more than an edge, so that half of its tetrahedra are inverted, is at rest as from the
 * undeformed shape. */
static void a_jumbled_block_finds_the_rest_of_the_undeformed_one(void **state) {
    (void)state;
    fix_random random = {5};
    for (law kind = NEO; kind <= MOONEY; kind += MOONEY - NEO) {
        bar b = make(kind, 0.49, (const int[]){4, 4, 4}, (const double[]){0.03, 0.03, 0.03});
        lead(&b, TWISTED, 20);
        const tm_settle_result still = settle(&b, 1e-8);
        double *u = tm_world_state(b.world)->u_m;
        for (int32_t i = 0; i < b.n; i++) u[i] = 0.01 * fix_signed(&random);
        const int32_t inverted = tm_tissue_deformation(b.tissue, u).inverted;
        const tm_settle_result jumbled = settle(&b, 1e-8);
        print_message("law %d: %d inverted, then %d; energy %.9g and %.9g J\n", kind, inverted,
                      jumbled.deformation.inverted, jumbled.energy_J, still.energy_J);
        assert_true(inverted > 100 && jumbled.deformation.inverted == 0);
        assert_true(fabs(jumbled.energy_J / still.energy_J - 1) < 1e-6);
        destroy(&b);
    }
}

static bool count(void *user, int64_t step, double residual) {
    (void)step, (void)residual;
    ++*(int *)user;
    return true;
}

/* Below the tolerance that rounding permits: the error is immediate, names a reachable tolerance, and nothing has
 * changed. */
static void work_is_bounded_and_the_error_says_what_can_be_done(void **state) {
    (void)state;
    bar b = usual(TURNING_VOLUME);
    tm_settle_def def = tm_settle_def_default();
    tm_settle_result result;
    tm_error error;
    int told = 0;
    def.tolerance = 1e-15, def.progress = count, def.user = &told;
    lead(&b, TURNED, 90);
    const uint64_t before = tm_world_hash(b.world);
    assert_int_equal(tm_world_settle(b.world, &def, &result, &error), TM_ERR_CONVERGENCE);
    const char *allow = strstr(error.message, "allow a tolerance of ");
    assert_true(allow && told > 0 && result.steps < 20000 && tm_world_hash(b.world) == before);
    settle(&b, strtod(allow + strlen("allow a tolerance of "), NULL));
    destroy(&b);
}

/* A spring of a caller's stage, explicit and too stiff for the step. */
typedef struct spring {
    double N_m;
} spring;

static void pull(void *self, tm_world *world) {
    tm_state *s = tm_world_state(world);
    const int32_t n = 3 * tm_tissue_mesh(tm_world_tissue(world))->vertex_count;
    for (int32_t i = 0; i < n; i++) s->force_N[i] -= ((const spring *)self)->N_m * s->u_m[i];
}

/* After a failed step the state is within the bound; with the step that world.h computes no step fails. */
static void a_blow_up_is_bounded_by_the_bodys_size(void **state) {
    (void)state;
    for (int limited = 0; limited < 2; limited++) {
        bar b = usual(LINEAR);
        spring own = {5000};
        tm_error error;
        tm_stage stage = {.size = sizeof stage, .name = "spring", .phase = TM_PHASE_LOAD, .self = &own, .run = pull};
        const double *mass = tm_tissue_mass_kg(b.tissue), g = tm_critical_step_guaranteed(b.tissue, NULL);
        double limit = HUGE_VAL;
        for (int32_t v = 0; v < b.n / 3; v++) limit = fmin(limit, 1 / sqrt(1 / (g * g) + own.N_m / (4 * mass[v])));
        tm_state *s = tm_world_state(b.world);
        fix_random random = {3};
        for (int32_t i = 0; i < b.n; i++) s->u_m[i] = s->u_prev_m[i] = 1e-3 * fix_signed(&random);
        if (limited) {
            stage.step_limit_s = limit;
            assert_int_equal(tm_world_add_stage(b.world, &stage, 0, &error), TM_ERR_STEP);
            fix_ok(tm_world_set_step(b.world, limit, &error), &error);
        }
        fix_ok(tm_world_add_stage(b.world, &stage, 0, &error), &error);
        tm_status status = TM_OK;
        for (int k = 0; k < 500 && status == TM_OK; k++) status = tm_world_step(b.world, 10);
        assert_int_equal(status, limited ? TM_OK : TM_ERR_UNSTABLE);
        const double size = sqrt(0.02 * 0.02 + 0.02 * 0.02 + 0.08 * 0.08);
        assert_true(fabs(tm_world_largest_displacement_m(b.world) - 1000 * size) < 1e-9);
        assert_true(fix_largest(s->u_m, b.n) <= (limited ? 2e-3 : 1000 * size));
        destroy(&b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ends_rotated_together_rotate_the_bar),
        cmocka_unit_test(one_call_finds_the_equilibrium_of_small_steps),
        cmocka_unit_test(sliding_ends_follow_the_rotation),
        cmocka_unit_test(increments_off_the_path_are_halved),
        cmocka_unit_test(bar_twisted_by_half_a_turn_stores_the_right_energy),
        cmocka_unit_test(ends_rotate_in_the_shorter_direction),
        cmocka_unit_test(a_slender_bar_buckles),
        cmocka_unit_test(supports_rotate_with_contact_too),
        cmocka_unit_test(linear_tissue_says_when_it_is_far_outside_its_range),
        cmocka_unit_test(tetrahedra_inside_out_are_counted),
        cmocka_unit_test(a_jumbled_block_finds_the_rest_of_the_undeformed_one),
        cmocka_unit_test(work_is_bounded_and_the_error_says_what_can_be_done),
        cmocka_unit_test(a_blow_up_is_bounded_by_the_bodys_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
