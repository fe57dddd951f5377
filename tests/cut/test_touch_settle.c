/* Static equilibrium of bodies in contact (tm_world_settle): contact bears the weight by its law, a long damped
 * simulation ends there, and what nothing holds is refused. */
#include "../long.h"
#include "touch_blocks.h"

#include "contact_law/compliance.h"

enum { STACK_MAX = 12 };
static const double TOLERANCE = 1e-9;

/* --- scenes --- */

/* Blocks on a wide one, each turned and shifted, with gaps between them. */
static void stack_up(int32_t count, fix_random *random, part *p) {
    const double gap_m = 0.6e-3, height_m = 0.015;
    p[0] = (part){{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0};
    for (int32_t i = 1; i < count; i++)
        p[i] = (part){{3, 3, 2},
                      {0.03, 0.03, height_m},
                      {0.01 + 1e-3 * fix_signed(random), 0.01 + 1e-3 * fix_signed(random),
                       0.02 + gap_m + (i - 1) * (height_m + gap_m)},
                      0.15 * fix_signed(random)};
}

static setup heavy(double mu) {
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.mu = mu;
    return s;
}

typedef enum held { BASE, BASE_AND_GUIDES, TABLE } held;

/* Holds the base or the complete lowest body; of the bodies above it, if they are guided, the top along x and y, so
 * that they can only sink. */
static void hold_parts(bodies *b, held what) {
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)b->mesh->vertex_count), count = 0;
    double *zero = calloc((size_t)b->mesh->vertex_count * 3, sizeof *zero);
    for (int32_t body = 0; body < b->count; body++) {
        double top_m = 0;
        for (int32_t v = b->body_begin[body]; v < b->body_begin[body + 1]; v++)
            top_m = fmax(top_m, b->mesh->rest_m[3 * v + 2]);
        for (int32_t v = b->body_begin[body]; v < b->body_begin[body + 1]; v++)
            for (int c = 0; c < 3; c++)
                if (body == 0 ? what == TABLE || at_base(b->mesh->rest_m + 3 * v)
                              : what == BASE_AND_GUIDES && c < 2 && b->mesh->rest_m[3 * v + 2] > top_m - 1e-9)
                    dof[count++] = 3 * v + c;
    }
    tm_support_def def = tm_support_def_default();
    def.count = count, def.dof = dof, def.value_m = zero;
    tm_error error;
    fix_ok(tm_stage_support(b->world, &def, &error), &error);
    free(dof), free(zero);
}

static void hold_guided(bodies *b) { hold_parts(b, BASE_AND_GUIDES); }
static void hold_base(bodies *b) { hold_parts(b, BASE); }
static void hold_table(bodies *b) { hold_parts(b, TABLE); }

static tm_status rest(bodies *b, tm_settle_result *result, tm_error *error) {
    tm_settle_def def = tm_settle_def_default();
    def.tolerance = TOLERANCE;
    return tm_world_settle(b->world, &def, result, error);
}

/* --- what holds at rest --- */

static double weight_N(const bodies *b, int32_t from) {
    double sum = 0;
    for (int32_t v = b->body_begin[from]; v < b->body_begin[b->count]; v++)
        sum += 9.81 * tm_tissue_mass_kg(b->tissue)[v];
    return sum;
}

/* Returns the upward force of all rows on the bodies from `from` on. */
static double lift_N(const bodies *b, int32_t from) {
    const tm_touching_row *row;
    double force = 0;
    for (int32_t i = 0, n = tm_touching_rows(b->touching, &row); i < n; i++) {
        double share = 0;
        for (int j = 0; j < 4; j++)
            if (row[i].vertex[j] >= b->body_begin[from]) share += row[i].weight[j];
        force += share * (row[i].lambda_N * row[i].normal[2] + row[i].across_N[2]);
    }
    return force;
}

/* Returns by how much rows miss the law, relative to the thickness: depth = c lambda, slope c/20 beyond; no force from
 * afar. */
static double law_error(const bodies *b) {
    const tm_touching_row *row;
    double most = 0;
    for (int32_t i = 0, n = tm_touching_rows(b->touching, &row); i < n; i++) {
        const double depth_m =
            law_compliance_depth(b->touching->solver[i].compliance_m_N, 0.3 * row[i].thickness_m, row[i].lambda_N);
        const double miss_m = row[i].lambda_N > 0 ? fabs(-row[i].gap_m - depth_m) : fmax(-row[i].gap_m, 0);
        most = fmax(most, miss_m / row[i].thickness_m);
    }
    return most;
}

/* Returns the maximum difference of two worlds' displacements, relative to the largest of the first. */
static double difference(const bodies *a, const bodies *b) {
    const int32_t n = 3 * a->mesh->vertex_count;
    const double *u = tm_world_state(a->world)->u_m, *w = tm_world_state(b->world)->u_m;
    double most_m = 0;
    for (int32_t i = 0; i < n; i++) most_m = fmax(most_m, fabs(u[i] - w[i]));
    return most_m / fix_largest(u, n);
}

static bodies stack_from(uint64_t seed, int32_t count, setup s) {
    fix_random random = {seed};
    part p[STACK_MAX];
    stack_up(count, &random, p);
    return make(p, count, &s);
}

static bodies stack_of(int32_t count, bool guided, setup s) {
    s.add_tools = guided ? hold_guided : hold_base;
    return stack_from((uint64_t)count, count, s);
}

static bodies stack(int32_t count, bool guided, double mu, int32_t threads) {
    setup s = heavy(mu);
    s.threads = threads;
    return stack_of(count, guided, s);
}

static tm_settle_result check_rest(bodies *b, const char *name) {
    tm_settle_result result = {0};
    tm_error error = {0};
    fix_ok(rest(b, &result, &error), &error);
    printf("%s: %lld steps, residual %.1e; rows miss the law by %.1e of the thickness\n", name, (long long)result.steps,
           result.residual, law_error(b));
    assert_true(law_error(b) < 1e-7 && kinetic_J(b) == 0);
    assert_true(tm_touching_get_report(b->touching).deepest_m == 0);
    for (int32_t k = 1; k < b->count; k++) {
        const double weight = weight_N(b, k), less = 1 - lift_N(b, k) / weight;
        printf("  body %d and above: weight %.9f N, contact bears %.1e of it less\n", k, weight, less);
        assert_true(fabs(less) < 1e-6);
    }
    return result;
}

/* --- tests --- */

static void guided_stacks_settle_where_a_simulation_ends(void **state) {
    (void)state;
    for (int32_t count = 2; count <= 3; count++) {
        bodies still = stack(count, true, 0, 1), moving = stack(count, true, 0, 1);
        check_rest(&still, "guided, without friction");
        run(&moving, 1.5);
        printf("  simulation: %.1e of the deflection off\n", difference(&still, &moving));
        assert_true(difference(&still, &moving) < 1e-6);
        drop(&still), drop(&moving);
    }
}

/* Drag is a force of motion: in short steps it would hold surfaces where they are. */
static void rest_does_not_depend_on_the_step(void **state) {
    (void)state;
    setup s = heavy(0);
    bodies a = stack_of(2, true, s);
    s.step_s = 1e-7;
    bodies b = stack_of(2, true, s);
    check_rest(&a, "the guaranteed step");
    check_rest(&b, "a step of 1e-7 s");
    printf("  differ by %.1e of the deflection\n", difference(&a, &b));
    assert_true(difference(&a, &b) < 1e-6);
    drop(&a), drop(&b);
}

/* Returns the maximum motion of a vertex in a simulation of 0.5 s. */
static double motion_m(bodies *b) {
    const size_t bytes = sizeof(double) * 3 * (size_t)b->mesh->vertex_count;
    double *u = malloc(bytes), most_m = 0;
    memcpy(u, tm_world_state(b->world)->u_m, bytes);
    run(b, 0.5);
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++)
        most_m = fmax(most_m, fabs(u[i] - tm_world_state(b->world)->u_m[i]));
    printf("  moves by %.1e m in 0.5 s\n", most_m);
    free(u);
    return most_m;
}

static void check_rests_and_stays(bodies *b, const char *name) {
    check_rest(b, name);
    const double sunk_m = fix_largest(tm_world_state(b->world)->u_m, 3 * b->mesh->vertex_count);
    assert_true(motion_m(b) < 1e-6 * sunk_m);
}

/* With friction the bodies are free. Where they rest depends on how they came there. Six did not settle before friction
 * was handed on where a vertex moves to another face. */
static void free_stacks_settle_and_then_stay(void **state) {
    (void)state;
    for (int32_t count = 2; count <= (test_is_long() ? 8 : 6); count += 2) {
        bodies b = stack(count, false, 0.3, 1);
        check_rests_and_stays(&b, "free, with friction");
        drop(&b);
    }
}

/* A stack that leans by 19 mm while single rows come and go: their fast motion hid the slow one. */
static void tall_stack_settles_while_rows_come_and_go(void **state) {
    (void)state;
    setup s = heavy(0.3);
    s.add_tools = hold_base;
    bodies b = stack_from(1, 10, s);
    check_rest(&b, "ten blocks");
    drop(&b);
}

/* Seven of ten blocks and one of twelve. Softer or with less friction some topple, in a simulation too. */
static void many_tall_stacks_settle_and_then_stay(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= (test_is_long() ? 8 : 0); seed++) {
        setup s = heavy(seed < 5 ? 0.3 : 0.1);
        s.add_tools = hold_base, s.young_Pa = seed < 5 ? 5000 : 20000;
        bodies b = stack_from(seed, seed == 8 ? STACK_MAX : 10, s);
        check_rests_and_stays(&b, seed < 5 ? "5 kPa, friction 0.3" : "20 kPa, friction 0.1");
        drop(&b);
    }
}

static void middle_of(const bodies *b, int32_t body, double u_m[3]) {
    const int32_t begin = b->body_begin[body], end = b->body_begin[body + 1];
    u_m[0] = u_m[1] = u_m[2] = 0;
    for (int32_t i = 3 * begin; i < 3 * end; i++) u_m[i % 3] += tm_world_state(b->world)->u_m[i] / (end - begin);
}

/* Facets press a free body sideways; without friction the first of these slides off in 25 s, the others in 3 s. The
 * friction that holds them is not there afterwards. */
static void free_bodies_without_friction_rest_near_the_start(void **state) {
    (void)state;
    for (int32_t count = 2; count <= (test_is_long() ? 8 : 3); count += count == 3 ? 5 : 1) {
        setup s = heavy(0);
        s.add_tools = hold_base, s.young_Pa = count > 3 ? 20000 : 5000;
        bodies b = stack_from(count == 8 ? 8 : 1, count, s);
        tm_settle_result r = check_rest(&b, "free, without friction");
        assert_true(r.held_friction > 0);
        for (int32_t k = 1; k < count; k++) {
            double u_m[3];
            middle_of(&b, k, u_m);
            printf("  body %d moved by (%.3f, %.3f, %.3f) mm\n", k, 1e3 * u_m[0], 1e3 * u_m[1], 1e3 * u_m[2]);
            assert_true(hypot(u_m[0], u_m[1]) < (count > 3 ? 0.12 : 0.06) * -u_m[2]);
        }
        run(&b, 0.01);
        const tm_touching_row *row;
        for (int32_t i = 0, n = tm_touching_rows(b.touching, &row); i < n; i++)
            assert_true(vnorm(b.touching->solver[i].friction_N) == 0);
        drop(&b);
    }
}

/* A body that comes to rest without friction is settled there, though that is 1.5 mm away. */
static void a_sliding_body_settles_where_it_comes_to_rest(void **state) {
    (void)state;
    setup s = heavy(0);
    s.add_tools = hold_base;
    bodies b = stack_from(3, 2, s);
    const tm_settle_result r = check_rest(&b, "one that slides");
    assert_true(r.held_friction == 0);
    assert_true(motion_m(&b) < 1e-8);
    drop(&b);
}

/* Settling must not carry bodies through each other: over a table that does not deform nothing damps the fall. */
static void bodies_fall_onto_each_other_from_afar(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        setup s = heavy(0.3);
        s.add_tools = k ? hold_base : hold_table, s.young_Pa = k ? 800 : 5000;
        const part p[] = {{{5, 5, 1}, {0.05, 0.05, 0.002}, {0, 0, 0}, 0},
                          {{3, 3, 1}, {0.03, 0.03, 0.003}, {0.01, 0.011, 0.2}, 0.1}};
        bodies b = make(p, 2, &s);
        check_rest(&b, "from 0.2 m above");
        assert_false(is_inside_another(&b));
        drop(&b);
    }
}

static void bodies_that_nothing_holds_are_refused(void **state) {
    (void)state;
    setup s = heavy(0.3);
    s.add_tools = hold_base;
    const part p[] = {{{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0}, {{3, 3, 1}, {0.03, 0.03, 0.01}, {0.06, 0, 0}, 0}};
    bodies b = make(p, 2, &s);
    tm_settle_result result = {0};
    tm_error error = {0};
    assert_int_equal(rest(&b, &result, &error), TM_ERR_SUPPORT);
    printf("%s\n", error.message);
    assert_non_null(strstr(error.message, "neither supports nor contact hold it"));
    assert_true(error.entity >= b.body_begin[1]);
    assert_true(fix_largest(tm_world_state(b.world)->u_m, 3 * b.mesh->vertex_count) == 0);
    drop(&b);
}

static void rest_has_the_same_bits_for_any_number_of_threads(void **state) {
    (void)state;
    bodies one = stack(3, false, 0.3, 1), two = stack(3, false, 0.3, 3);
    tm_settle_result result = {0};
    tm_error error = {0};
    fix_ok(rest(&one, &result, &error), &error);
    fix_ok(rest(&two, &result, &error), &error);
    assert_memory_equal(tm_world_state(one.world)->u_m, tm_world_state(two.world)->u_m,
                        sizeof(double) * 3 * (size_t)one.mesh->vertex_count);
    drop(&one), drop(&two);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(guided_stacks_settle_where_a_simulation_ends),
        cmocka_unit_test(rest_does_not_depend_on_the_step),
        cmocka_unit_test(free_stacks_settle_and_then_stay),
        cmocka_unit_test(tall_stack_settles_while_rows_come_and_go),
        cmocka_unit_test(many_tall_stacks_settle_and_then_stay),
        cmocka_unit_test(free_bodies_without_friction_rest_near_the_start),
        cmocka_unit_test(a_sliding_body_settles_where_it_comes_to_rest),
        cmocka_unit_test(bodies_fall_onto_each_other_from_afar),
        cmocka_unit_test(bodies_that_nothing_holds_are_refused),
        cmocka_unit_test(rest_has_the_same_bits_for_any_number_of_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
