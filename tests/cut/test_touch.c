/* Contact of tissue with tissue: closed forms, momentum, the broad phase against all pairs, threads, fast bodies, rest,
 * folds and lips. */
#include "../long.h"
#include "touch_blocks.h"

static const part table = {{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0};
static part above(double gap_m, double turn_rad) {
    return (part){{3, 3, 2}, {0.03, 0.03, 0.02}, {0.0132, 0.0071, 0.02 + gap_m}, turn_rad};
}

/* --- closed forms --- */

static void upper_block_at_rest_bears_its_weight_on_the_lower(void **state) {
    (void)state;
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.is_held = at_base, s.mu = 0.1;
    const part p[] = {table, above(0.6e-3, 0.2)};
    bodies b = make(p, 2, &s);
    run(&b, 1);
    const tm_touching_row *row;
    double force = 0, weight = 0;
    for (int32_t i = 0, n = tm_touching_rows(b.touching, &row); i < n; i++)
        force += (row[i].lambda_N * row[i].normal[2] + row[i].across_N[2]) *
                 (row[i].edges || row[i].vertex[0] >= b.body_begin[1] ? 1 : -1);
    for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++) weight += 9.81 * tm_tissue_mass_kg(b.tissue)[v];
    printf("weight %.9f N, contact %.9f N, kinetic %.2e J, rows %d\n", weight, force, kinetic_J(&b),
           tm_touching_get_report(b.touching).rows);
    assert_true(fabs(force - weight) < 1e-6 * weight);
    assert_true(kinetic_J(&b) < 1e-9);
    assert_true(tm_touching_get_report(b.touching).deepest_m == 0);
    drop(&b);
}

static void colliding_blocks_keep_their_momentum(void **state) {
    (void)state;
    setup s = plain();
    s.damping_1_s = 0, s.mu = 0.3;
    const part p[] = {{{4, 4, 2}, {0.04, 0.04, 0.02}, {0, 0, 0}, 0}, above(0.01, 0.3)};
    bodies b = make(p, 2, &s);
    throw_body(&b, 0, 0, 0, 0.2), throw_body(&b, 1, 0.05, 0.02, -0.5);
    double before[3], after[3];
    momentum(&b, before);
    const double energy_J = kinetic_J(&b);
    run(&b, 0.05);
    momentum(&b, after);
    const double met = kinetic_J(&b) + tm_tissue_energy(b.tissue, tm_world_state(b.world)->u_m);
    printf("momentum %.6g %.6g %.6g -> less %.2e %.2e %.2e N s; energy %.6g -> %.6g J\n", before[0], before[1],
           before[2], after[0] - before[0], after[1] - before[1], after[2] - before[2], energy_J, met);
    for (int c = 0; c < 3; c++) assert_true(fabs(after[c] - before[c]) < 1e-13 * fabs(before[2]) * 1000);
    assert_true(met < energy_J && met > 0.05 * energy_J);
    assert_true(tm_touching_get_report(b.touching).gathers > 1);
    drop(&b);
}

/* Checks that the upper block is still above the lower one. */
static void nothing_passes_through_at_half_a_metre_a_second(void **state) {
    (void)state;
    const int count = test_is_long() ? 60 : 6;
    fix_random random = {3};
    for (int i = 0; i < count; i++) {
        setup s = plain();
        s.is_held = at_base, s.damping_1_s = 20;
        const part p[] = {table, above(2e-3 + 1e-3 * fix_uniform(&random), 3 * fix_signed(&random))};
        bodies b = make(p, 2, &s);
        throw_body(&b, 1, 0.2 * fix_signed(&random), 0.2 * fix_signed(&random), -0.5);
        double deepest = 0;
        for (int k = 0; k < 40; k++) {
            assert_int_equal(tm_world_step(b.world, 5), TM_OK);
            deepest = fmax(deepest, tm_touching_get_report(b.touching).deepest_m);
            assert_false(is_inside_another(&b));
        }
        if (i == 0) printf("step %.3g ms, deepest overlap %.3g mm\n", 1e3 * tm_world_step_s(b.world), 1e3 * deepest);
        assert_true(deepest < 0.05e-3);
        assert_false(tm_touching_get_report(b.touching).overflowed);
        drop(&b);
    }
}

/* --- the broad phase, threads, snapshots --- */

static uint64_t story(int32_t threads, bool all_pairs, int64_t *gathers) {
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.is_held = at_base, s.threads = threads, s.cuttable = true, s.mu = 0.3;
    const part p[] = {{{8, 8, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0}, above(1e-3, 0.4), above(23e-3, -0.7)};
    bodies b = make(p, 3, &s);
    b.touching->all_pairs = all_pairs;
    throw_body(&b, 2, 0.1, 0, -0.4);
    uint64_t hash = TM_HASH_SEED;
    for (int k = 0; k < 9; k++) {
        assert_int_equal(tm_world_step(b.world, 25), TM_OK);
        const tm_touching_row *row;
        const int32_t n = tm_touching_rows(b.touching, &row);
        hash = hash_of_rows(row, n, hash);
        if (k == 5) {
            const int32_t gone[] = {5, 6, 7, 8, 9, 10, 90, 91, 92, 93, 94, 95};
            tm_cut_remove(b.tissue, gone, 12, NULL, 0);
        }
    }
    *gathers = tm_touching_get_report(b.touching).gathers;
    hash ^= tm_world_hash(b.world);
    drop(&b);
    return hash;
}

static void rows_are_those_of_all_pairs_for_any_threads(void **state) {
    (void)state;
    int64_t gathers = 0, other = 0;
    const uint64_t one = story(1, false, &gathers);
    printf("%lld gatherings in 225 substeps\n", (long long)gathers);
    assert_true(gathers < 100);
    for (int32_t threads = 2; threads <= 4; threads += 2)
        assert_true(one == story(threads, false, &other) && other == gathers);
    assert_true(one == story(1, true, &other));
}

/* A small body flies off from a large one: it alone is searched again. */
static void what_moves_alone_is_searched_alone(void **state) {
    (void)state;
    setup s = plain();
    s.is_held = at_base, s.damping_1_s = 5;
    const part p[] = {{{8, 8, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0}, {{2, 2, 2}, {0.01, 0.01, 0.01}, {0, 0, 0.023}, 0}};
    bodies b = make(p, 2, &s);
    throw_body(&b, 1, 0.5, 0.5, 0);
    run(&b, 0.2);
    const tm_touching_report r = tm_touching_get_report(b.touching);
    double way_m = 0;
    for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++)
        way_m = fmax(way_m, tm_world_state(b.world)->u_m[3 * v]);
    printf("moved by %.1f mm; %lld searches of the complete surface\n", 1e3 * way_m, (long long)r.gathers);
    assert_true(way_m > 0.025 && r.gathers == 1);
    drop(&b);
}

static void snapshots_continue_bit_for_bit(void **state) {
    (void)state;
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.is_held = at_base, s.mu = 0.3;
    const part p[] = {table, above(0.4e-3, 0.4)};
    bodies b = make(p, 2, &s);
    run(&b, 0.05);
    tm_error error;
    const int64_t bytes = tm_snapshot_bytes(b.world);
    assert_true(bytes <= tm_snapshot_bytes_max(b.world));
    void *saved = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(b.world, saved, bytes, &error), &error);
    run(&b, 0.05);
    const uint64_t hash = tm_world_hash(b.world);
    fix_ok(tm_snapshot_restore(b.world, saved, bytes, &error), &error);
    run(&b, 0.05);
    assert_true(hash == tm_world_hash(b.world));
    free(saved);
    drop(&b);
}

/* --- one body that touches itself --- */

static void push_upper_lip(bodies *b, double acceleration_m_s2) {
    tm_state *s = tm_world_state(b->world);
    for (int32_t v = 0; v < b->mesh->vertex_count; v++)
        if (b->mesh->rest_m[3 * v + 2] > 0.0149) s->u_prev_m[3 * v + 2] += acceleration_m_s2 * s->dt_s * s->dt_s * 20;
}

/* Closed by a push and released: the lips touch, do not cross, and open again without generated energy. */
static void lips_of_a_cut_close_and_open_without_gaining_energy(void **state) {
    (void)state;
    double left_J[2];
    for (int touching = 0; touching < 2; touching++) {
        setup s = plain();
        s.young_Pa = 3000, s.damping_1_s = 5, s.cuttable = true, s.is_held = at_base;
        if (!touching) s.touch.pair = (const uint8_t[]){0};
        bodies b = mouth(&s);
        tm_error error;
        fix_ok(tm_stage_energy(b.world, &error), &error);
        tm_energy e;
        double deepest = 0, most_J = 0, stored_J = 0, lowest_m = 1;
        for (int k = 0; k < 120; k++) {
            if (k < 30) push_upper_lip(&b, 6);
            assert_int_equal(tm_world_step(b.world, 20), TM_OK);
            fix_ok(tm_world_energy(b.world, &e, &error), &error);
            stored_J = fmax(stored_J, e.kinetic_J + e.elastic_J);
            most_J = fmax(most_J, e.touch_J + e.touch_stored_J);
            deepest = fmax(deepest, tm_touching_get_report(b.touching).deepest_m);
            for (int32_t v = 0; v < b.mesh->vertex_count; v++)
                if (fabs(b.mesh->rest_m[3 * v + 2] - 0.015) < 1e-9 && b.mesh->rest_m[3 * v] > 0.059)
                    lowest_m = fmin(lowest_m, 0.015 + tm_world_state(b.world)->u_m[3 * v + 2]);
        }
        left_J[touching] = e.kinetic_J + e.elastic_J;
        printf(
            "touching %d: lip down to %.2f mm; stored at most %.3g J, touch made %.2g J, left %.3g J, residual %.1e J, "
            "deepest %.2g mm\n",
            touching, 1e3 * lowest_m, stored_J, most_J, left_J[touching], e.residual_J, 1e3 * deepest);
        assert_true(fabs(e.residual_J) < 1e-9 * stored_J);
        assert_true(!touching || (most_J < 0.01 * stored_J && deepest < 0.05e-3 && lowest_m > 0.009));
        assert_true(touching || lowest_m < 0.008); /* otherwise the test proves nothing */
        assert_true(touching || most_J == 0);
        assert_false(tm_touching_get_report(b.touching).overflowed);
        drop(&b);
    }
}

/* --- ties --- */

enum { TIES = 16 };

/* A block below a fixed one: ties connect its top vertices to the base of the upper one. */
static int32_t tie_up(bodies *b, double stiffness_N_m, double break_N, tm_ties **ties) {
    int32_t *triangle = malloc(sizeof *triangle * 3 * (size_t)b->mesh->surface_count), triangles = 0;
    for (int32_t i = 0; i < b->mesh->surface_count; i++)
        if (b->tet_body[b->mesh->surface_face[i] / 4] == 0)
            memcpy(triangle + 3 * triangles++, b->mesh->surface + 3 * i, 3 * sizeof *triangle);
    tm_tie tie[TIES];
    tm_ties_def def = tm_ties_def_default();
    for (int32_t v = b->body_begin[1]; v < b->body_begin[2]; v++) {
        if (b->mesh->rest_m[3 * v + 2] < -0.0051 || def.count == TIES) continue;
        tie[def.count] = (tm_tie){.stiffness_N_m = stiffness_N_m, .break_N = break_N};
        assert_true(tm_tie_lead(b->mesh, v, triangle, triangles, tie + def.count));
        assert_true(fabs(tie[def.count++].rest_m - 0.005) < 1e-12);
    }
    def.tie = tie;
    tm_error error;
    fix_ok(tm_stage_ties(b->world, &def, ties, &error), &error);
    free(triangle);
    return def.count;
}

static const part hung[] = {{{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0},
                            {{3, 3, 2}, {0.03, 0.03, 0.02}, {0.01, 0.01, -0.025}, 0}};

static void ties_bear_a_weight_and_break_at_their_load(void **state) {
    (void)state;
    for (int breaks = 0; breaks < 2; breaks++) {
        setup s = plain();
        s.gravity_m_s2 = 9.81, s.is_held = at_base, s.damping_1_s = 30;
        bodies b = make(hung, 2, &s);
        tm_ties *ties = NULL;
        tm_error error;
        fix_ok(tm_stage_energy(b.world, &error), &error);
        const int32_t count = tie_up(&b, 20, breaks ? 0.005 : 0, &ties);
        assert_int_equal(count, TIES);
        run(&b, 1.5);
        double force = 0, weight = 0, from[3], to[3];
        int32_t gone[TIES], why[TIES];
        for (int32_t i = 0; i < count; i++) {
            const double one = tm_ties_force_N(ties, i, from, to);
            force += one * (to[2] - from[2]) /
                     sqrt(pow(to[0] - from[0], 2) + pow(to[1] - from[1], 2) + pow(to[2] - from[2], 2));
        }
        for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++) weight += 9.81 * tm_tissue_mass_kg(b.tissue)[v];
        const int32_t went = tm_ties_fetch_cut(ties, gone, why, TIES);
        tm_energy e;
        fix_ok(tm_world_energy(b.world, &e, &error), &error);
        printf("ties bear %.9f N of %.9f N; %d went; residual %.1e J of %.2e J\n", force, weight, went, e.residual_J,
               e.gravity_J);
        assert_true(fabs(e.residual_J) < 1e-10 && e.touch_J + e.touch_stored_J < 1e-12);
        assert_true(breaks ? went == TIES && why[0] == TM_TIE_BROKE && !tm_ties_is_whole(ties, gone[0])
                           : went == 0 && fabs(force - weight) < 1e-6 * weight);
        assert_int_equal(tm_ties_fetch_cut(ties, gone, why, TIES), 0);
        drop(&b);
    }
}

/* A cautery that passes through the ties cuts them one by one, and only while it is active. */
static bool in_table(const double rest_m[3]) { return rest_m[2] > -1e-9 && rest_m[2] < 0.02 + 1e-9; }

static void add_probe(bodies *b) {
    tm_instrument_def probe = {.mode = TM_TOOL_PROBE,
                               .radius_m = 0.0025,
                               .contact_length_m = 0.02,
                               .trocar_m = {0.005, 0.005, 0.15},
                               .pose = {.tip_m = {0.005, 0.005, 0.03}, .active = true}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &probe;
    tm_error error;
    fix_ok(tm_stage_contact(b->world, &contact, &b->contact, &error), &error);
}

static void supports_bear_what_rests_hangs_and_presses_on_them(void **state) {
    (void)state;
    const part p[] = {table, {{3, 3, 2}, {0.03, 0.03, 0.02}, {0.01, 0.01, -0.025}, 0}, above(0.6e-3, 0.2)};
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.is_held = in_table, s.damping_1_s = 30, s.mu = 0.1, s.add_tools = add_probe;
    bodies b = make(p, 3, &s);
    tm_ties *ties = NULL;
    assert_int_equal(tie_up(&b, 20, 0, &ties), TIES);
    tm_contact_begin_frame(b.contact, 100, 100);
    tm_contact_set_target(b.contact, 0, &(tm_tool_pose){.tip_m = {0.005, 0.005, 0.0222}, .active = true}, 100);
    run(&b, 1);
    tm_contact_begin_frame(b.contact, 1, 1); /* its force is that of the last step */
    assert_int_equal(tm_world_step(b.world, 1), TM_OK);
    double held = 0, weight = 0, *reaction = calloc(3 * (size_t)b.mesh->vertex_count, sizeof *reaction);
    tm_support_reaction(b.world, reaction);
    for (int32_t v = 0; v < b.mesh->vertex_count; v++)
        held += reaction[3 * v + 2], weight += 9.81 * tm_tissue_mass_kg(b.tissue)[v];
    const double pressed = tm_contact_reaction(b.contact, 0).resultant_N[2];
    printf("supports bear %.9f N of %.9f N of weight and %.9f N of a probe\n", held, weight, pressed);
    assert_true(pressed > 0.1 && fabs(held - weight - pressed) < 1e-6 * held);
    free(reaction);
    drop(&b);
}

static void a_cautery_cuts_the_ties_that_it_touches(void **state) {
    (void)state;
    setup s = plain();
    s.is_held = at_base, s.cuttable = true;
    bodies b = make(hung, 2, &s);
    tm_instrument_def tool = {.mode = TM_TOOL_CAUTERY, .radius_m = 1e-3, .contact_length_m = 0.1};
    memcpy(tool.trocar_m, (double[3]){0.02, -0.2, -0.0025}, sizeof tool.trocar_m);
    memcpy(tool.pose.tip_m, (double[3]){0.02, -0.05, -0.0025}, sizeof tool.pose.tip_m);
    tm_contact_def contact_def = tm_contact_def_default();
    contact_def.instrument_count = 1, contact_def.instrument = &tool;
    tm_contact *contact;
    tm_error error;
    fix_ok(tm_stage_contact(b.world, &contact_def, &contact, &error), &error);
    tm_ties *ties;
    tie_up(&b, 20, 0, &ties);
    int32_t went = 0, most = 0, gone[TIES], why[TIES];
    for (int active = 0; active < 2; active++)
        for (int k = 0; k <= 40; k++) { /* from the side through the gap and back */
            const tm_tool_pose to = {.tip_m = {0.02, -0.05 + 0.1 * k / 40, -0.0025}, .active = active == 1};
            tm_contact_begin_frame(contact, 5, 5);
            tm_contact_set_target(contact, 0, &to, 5);
            assert_int_equal(tm_world_step(b.world, 5), TM_OK);
            const int32_t now = tm_ties_fetch_cut(ties, gone, why, TIES);
            for (int32_t i = 0; i < now; i++) assert_int_equal(why[i], 0);
            went += now, most = now > most ? now : most;
            if (!active) assert_int_equal(now, 0);
        }
    printf("the cautery cut %d of %d ties, at most %d at a time\n", went, TIES, most);
    assert_true(went > 0 && went < TIES && most < went);
    drop(&b);
}

/* In each substep a block is put 0.3 mm into another: pushing it out may give energy once, not each time. */
static void pushing_out_again_and_again_gives_little_energy(void **state) {
    (void)state;
    setup s = plain();
    s.is_held = at_base, s.young_Pa = 50000, s.damping_1_s = 10;
    const part p[] = {{{3, 3, 2}, {0.03, 0.03, 0.02}, {0, 0, 0}, 0},
                      {{2, 2, 1}, {0.02, 0.02, 0.01}, {0.0057, 0.0043, 0.0206}, 0}};
    bodies b = make(p, 2, &s);
    tm_error error;
    tm_energy e;
    fix_ok(tm_stage_energy(b.world, &error), &error);
    for (int k = 0; k < 40; k++) {
        tm_state *now = tm_world_state(b.world);
        for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++)
            for (int c = 0; c < 3; c++) now->u_m[3 * v + c] = now->u_prev_m[3 * v + c] = c == 2 ? -0.9e-3 : 0;
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
    }
    fix_ok(tm_world_energy(b.world, &e, &error), &error);
    printf("pushed out 40 times: contact gave %.3g J\n", e.touch_J + e.touch_stored_J);
    assert_true(e.touch_J + e.touch_stored_J < 1e-3 && e.touch_J + e.touch_stored_J > 1e-5);
    drop(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(upper_block_at_rest_bears_its_weight_on_the_lower),
        cmocka_unit_test(colliding_blocks_keep_their_momentum),
        cmocka_unit_test(nothing_passes_through_at_half_a_metre_a_second),
        cmocka_unit_test(rows_are_those_of_all_pairs_for_any_threads),
        cmocka_unit_test(what_moves_alone_is_searched_alone),
        cmocka_unit_test(snapshots_continue_bit_for_bit),
        cmocka_unit_test(ties_bear_a_weight_and_break_at_their_load),
        cmocka_unit_test(supports_bear_what_rests_hangs_and_presses_on_them),
        cmocka_unit_test(a_cautery_cuts_the_ties_that_it_touches),
        cmocka_unit_test(pushing_out_again_and_again_gives_little_energy),
        cmocka_unit_test(lips_of_a_cut_close_and_open_without_gaining_energy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
