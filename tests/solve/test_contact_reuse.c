/* Contact reuse: contact with condensed tissue between two full contact solves. Static contact is exact; moving
 * contact stays close to a full solve in every substep; after a cut contact is detected in every substep; a snapshot
 * between full solves continues bit-identically. */
#include "hybrid_set.h"

/* Advances the tool towards `to` by one substep; with `whole`, by a full contact solve. */
static void substep(hybrid_set *s, const tm_tool_pose *to, bool whole, double force_N[3]) {
    if (whole) tms_contact_reuse_forget(s->hybrid);
    tm_contact_begin_frame(s->contact, 1, 1);
    tm_contact_set_target(s->contact, 0, to, 1);
    assert_int_equal(tm_world_step(s->world, 1), TM_OK);
    const tm_tool_reaction r = tm_hybrid_reaction(s->hybrid, 0);
    if (force_N) memcpy(force_N, r.force_N, 24);
}

static double off(const double a[3], const double b[3]) {
    double sum = 0;
    for (int c = 0; c < 3; c++) sum += (a[c] - b[c]) * (a[c] - b[c]);
    return sqrt(sum);
}

/* --- rows alone --- */

/* Checks that the force of every row equals that of its contact compliance at its gap. */
static void row_force_equals_its_contact_compliance(void **state) {
    (void)state;
    static tms_reuse_system s;
    fix_random random = {7};
    int32_t solved = 0, capped = 0, free = 0;
    for (int run = 0; run < 300; run++) {
        double lever[12][4];
        s.count = 1 + run % 12;
        s.cap_N = run % 3 ? 10 : 0.3;
        for (int32_t i = 0; i < s.count; i++) {
            for (int k = 0; k < 4; k++) lever[i][k] = fix_uniform(&random) - (k ? 0.3 : 0);
            s.gap_m[i] = 0.004 * (fix_uniform(&random) - 0.7);
            s.row_compliance_m_N[i] = 0.5e-3 / (0.05 + fix_uniform(&random));
            s.radius_m[i] = 0.004;
            s.lambda_N[i] = fix_uniform(&random);
            for (int32_t j = 0; j <= i;
                 j++) { /* few shapes of the tissue: nearly singular without contact compliance */
                double give = 0;
                for (int k = 0; k < 4; k++) give += 0.01 * lever[i][k] * lever[j][k];
                s.delassus_m_N[i][j] = s.delassus_m_N[j][i] = give;
            }
        }
        if (!tms_reuse_solve(&s)) continue;
        solved++;
        for (int32_t i = 0; i < s.count; i++) {
            const double load_N = tm_contact_compliance_reaction(s.row_compliance_m_N[i], s.radius_m[i],
                                                                 tms_reuse_gap(&s, i), 0, s.cap_N);
            assert_true(fabs(load_N - s.lambda_N[i]) < 1e-6 * (1 + load_N));
            capped += load_N == s.cap_N;
            free += load_N == 0;
        }
    }
    print_message("  %d of 300 solved; %d rows at the cap, %d bear nothing\n", solved, capped, free);
    assert_true(solved > 285 && capped > 5 && free > 100);
}

/* --- at rest --- */

/* A resting tool far from the interface reaches the longest reuse interval and the precomputed model's force. */
static void tool_at_rest_has_the_longest_interval(void **state) {
    (void)state;
    const tm_tool_pose above = {.tip_m = {-0.018, 0.003, 0.05}, .active = true},
                       down = {.tip_m = {-0.018, 0.003, 0.0405}, .active = true};
    hybrid_set s = set_touched(&above);
    double force[3], first[3];
    set_go(&s, &down, 0.2, NULL);
    set_go(&s, &down, 0.8, force);
    assert_int_equal(s.hybrid->reuse->kind[0], TMS_TOOL_FROZEN);
    assert_int_equal(s.hybrid->reuse->length, TMS_REUSE_MAX);
    int32_t followed = 0;
    for (int step = 0; step < 2 * TMS_REUSE_MAX; step++) {
        substep(&s, &down, false, first);
        followed += s.hybrid->reuse->age > 0;
        assert_true(off(first, force) < 1e-7 * fix_largest(force, 3));
    }
    assert_int_equal(followed, 2 * TMS_REUSE_MAX - 2);
    tm_precomputed_def full = tm_precomputed_def_default();
    tm_instrument_def tool = s.hybrid->instrument[0];
    tm_contact_def contact = s.hybrid->contact_def;
    tool.pose.tip_m[2] = 0.06;
    contact.instrument = &tool;
    full.problem = kit_problem(s.whole, s.fixed);
    full.contact = &contact;
    tm_precomputed *model;
    tm_error error;
    fix_ok(tm_precomputed_create(&full, &model, NULL, &error), &error);
    assert_true(tm_precomputed_update(model, &down) >= 0);
    tm_precomputed_force(model, 0, first);
    print_message("  %.4f N, off the precomputed model by %.1e\n", fix_largest(force, 3),
                  off(first, force) / fix_largest(force, 3));
    assert_true(fix_largest(force, 3) > 0.05);
    assert_true(off(first, force) < 1e-6 * fix_largest(force, 3));
    tm_precomputed_destroy(model);
    set_free(&s);
}

/* --- in motion --- */

typedef struct stroke {
    double at[3], by[3]; /* from there, by this distance in `steps` substeps, there and back */
    int32_t steps, cut_at;
    double cut_x_m; /* tetrahedra of the dynamic part above are removed there */
} stroke;

static void cut_under(hybrid_set *s, double x_m) {
    int32_t list[512], count = 0;
    for (int32_t t = 0; t < s->mesh->tet_count && count < 512; t++) {
        double x = 0, z = 0;
        for (int i = 0; i < 4; i++)
            x += s->mesh->rest_m[3 * s->mesh->tet[4 * t + i]] / 4,
                z += s->mesh->rest_m[3 * s->mesh->tet[4 * t + i] + 2] / 4;
        if (s->dynamic[t] && x > x_m && z > 0.03) list[count++] = t;
    }
    assert_true(tm_cut_remove(s->tissue, list, count, NULL, 0) >= count);
}

/* Returns the largest difference of the force, relative to its peak, between a stroke with reuse and one with full
 * solves. */
static double differ_in(const scene_def *def, const stroke *st, int32_t *followed) {
    double peak = 0, most = 0, force[2][3];
    tm_tool_pose at = {.active = true};
    memcpy(at.tip_m, st->at, 24);
    at.tip_m[2] += 0.004;
    hybrid_set s[2] = {set_touched_by(def, &at), set_touched_by(def, &at)};
    *followed = 0;
    for (int32_t step = 0; step < 200 + 2 * st->steps; step++) {
        const double down = fmin(1, step / 150.0),
                     way = step < 200 ? 0 : 1 - fabs(1 - (double)(step - 200) / st->steps);
        for (int c = 0; c < 3; c++) at.tip_m[c] = st->at[c] + way * st->by[c] + (c == 2 ? 0.004 * (1 - down) : 0);
        for (int i = 0; i < 2; i++) {
            if (step == st->cut_at) cut_under(&s[i], st->cut_x_m);
            substep(&s[i], &at, i == 1, force[i]);
        }
        *followed += s[0].hybrid->reuse->age > 0;
        peak = fmax(peak, fix_largest(force[1], 3));
        most = fmax(most, off(force[0], force[1]));
    }
    for (int i = 0; i < 2; i++) set_free(&s[i]);
    assert_true(peak > 0.05);
    return most / peak;
}

static double differ(const stroke *st, int32_t *followed) {
    const scene_def def = set_def();
    return differ_in(&def, st, followed);
}

static void moving_contact_stays_close_to_full_solves(void **state) {
    (void)state;
    const stroke slide = {{-0.020, -0.006, 0.0405}, {0.004, 0.012, 0}, 300, -1, 0};
    int32_t followed;
    const double most = differ(&slide, &followed);
    print_message("  pressed and slid on condensed tissue: off full solutions by %.2f %% of the peak, %d of 800 "
                  "substeps followed\n",
                  100 * most, followed);
    assert_true(followed > 400);
    assert_true(most < 0.03);
}

/* In a steady slide each reuse interval has the same force drift, which the next one predicts: intervals get longer
 * for the same jump of the force. Drift that two intervals do not share is not predicted. */
static void steady_slide_lengthens_intervals(void **state) {
    (void)state;
    const tm_tool_pose above = {.tip_m = {-0.018, -0.006, 0.05}, .active = true};
    double most[2] = {0};
    int32_t followed[2] = {0};
    for (int blind = 0; blind < 2; blind++) {
        tm_tool_pose at = {.tip_m = {-0.018, -0.006, 0.0405}, .active = true};
        hybrid_set s = set_touched(&above);
        tms_contact_reuse *span = s.hybrid->reuse;
        double before[3], force[3], peak = 0;
        set_go(&s, &at, 0.2, NULL);
        for (int step = 0; step < 300; step++) {
            at.tip_m[1] += 2e-5;
            if (blind)
                memset(span->predicted_growth, 0, sizeof span->predicted_growth),
                    memset(span->last_growth, 0, sizeof span->last_growth);
            substep(&s, &at, false, force);
            followed[blind] += span->age > 0;
            if (step > 0) most[blind] = fmax(most[blind], off(force, before));
            memcpy(before, force, 24);
            peak = fmax(peak, fix_largest(force, 3));
        }
        most[blind] /= peak;
        set_go(&s, &at, 1, NULL);
        assert_true(span->predicted_growth[0] == 0); /* at rest no jump is permitted */
        set_free(&s);
    }
    print_message("  slid evenly: %d of 300 substeps followed, largest change %.2f %%; blindly %d, %.2f %%\n",
                  followed[0], 100 * most[0], followed[1], 100 * most[1]);
    assert_true(300 - followed[0] < 0.75 * (300 - followed[1]));
}

/* The surroundings of a tool are kept while tool and tissue stay, and searched again before oscillating tissue could
 * come near. */
static void surroundings_are_kept_while_nothing_comes_near(void **state) {
    (void)state;
    scene_def def = set_def();
    def.damping_1_s = 30;
    const tm_tool_pose at = {.tip_m = {0.018, 0.003, 0.0405}, .active = true};
    hybrid_set s = set_touched_by(&def, &at);
    const tms_contact_solver *l = &s.hybrid->solver_contact;
    const tm_state *now = tm_world_state(s.world);
    const size_t n = 3 * (size_t)s.mesh->vertex_count;
    double *was = malloc(8 * n), most = 0, swings = 0;
    int32_t oldest = 0, looks = 0, last = 0;
    set_go(&s, &at, 0.5, NULL);
    for (int step = 0; step < 600; step++) {
        for (size_t d = 0; step == 200 && d < n; d++) /* thrown sideways */
            if (tm_tissue_mass_kg(s.tissue)[d / 3] > 0 && d % 3 == 0 && !s.fixed[d]) now->u_prev_m[d] -= 2e-4;
        substep(&s, &at, false, NULL);
        if (l->gathered_age <= last || step == 0) memcpy(was, now->u_m, 8 * n), looks += step > 200;
        last = l->gathered_age;
        if (step < 200 && last > oldest) oldest = last;
        for (size_t d = 0; d < n; d++) {
            if (tm_tissue_mass_kg(s.tissue)[d / 3] > 0) most = fmax(most, fabs(now->u_m[d] - was[d]));
            swings = fmax(swings, fabs(now->u_m[d]));
        }
    }
    print_message("  kept for %d substeps at rest; thrown by %.1f mm, looked for %d times, moved by %.1f mm at most\n",
                  oldest, 1e3 * swings, looks, 1e3 * most);
    assert_true(oldest > 100 && looks > 4);
    assert_true(swings > 3 * def.radius_m && most < 0.75 * def.radius_m);
    free(was);
    set_free(&s);
}

/* On dynamic tissue far from the interface, where rows are detected in every substep: no loaded row is missed,
 * however far the tissue oscillates. */
static void oscillating_tissue_misses_no_row(void **state) {
    (void)state;
    scene_def def = set_def();
    def.young_Pa = 700; /* soft, light under a blunt tool, and weakly damped */
    def.radius_m = 0.005;
    def.damping_1_s = 30;
    const stroke slide = {{0.018, -0.006, 0.0405}, {0, 0.012, 0}, 300, -1, 0};
    int32_t followed;
    const double most = differ_in(&def, &slide, &followed);
    print_message("  pressed and slid on what has mass: off full solutions by %.2f %% of the peak, %d of 800 substeps "
                  "followed\n",
                  100 * most, followed);
    assert_true(followed > 700);
    assert_true(most < 0.02);
}

/* At the end of a reuse interval such a tool keeps the force just computed; it is not solved again. */
static void tool_keeps_its_force_at_the_end_of_an_interval(void **state) {
    (void)state;
    const scene_def def = set_def();
    tm_tool_pose at = {.tip_m = {0.018, -0.006, 0.0405}, .active = true};
    hybrid_set s = set_touched_by(&def, &at);
    const tms_contact_reuse *span = s.hybrid->reuse;
    const tms_contact_eval *now = &s.hybrid->solver_contact.now;
    int32_t ends = 0;
    set_go(&s, &at, 0.05, NULL);
    for (int step = 0; step < 300; step++) {
        const int32_t age = span->age;
        at.tip_m[1] += 4e-5;
        substep(&s, &at, false, NULL);
        if (age < 0 || span->age != 0) continue;
        ends++;
        assert_true(now->count > 0);
        assert_int_equal(now->count, span->system.count);
        for (int32_t i = 0; i < now->count; i++) assert_true(now->row[i].lambda_N == span->system.lambda_N[i]);
    }
    assert_true(ends > 10);
    set_free(&s);
}

/* Tissue of little mass that a cut has left at the interface: rows are detected in every substep. */
static void light_remnant_is_detected_in_every_substep(void **state) {
    (void)state;
    const stroke lip = {{0.006, 0.002, 0.0405}, {0, 0.004, 0}, 200, 220, 0.012};
    int32_t followed;
    const double most = differ(&lip, &followed);
    print_message("  on what a cut has left: off full solutions by %.2f %% of the peak, %d of 600 substeps followed\n",
                  100 * most, followed);
    assert_true(most < 0.05);
    /* on the interface too, where rows can be reused until it is cut */
    const stroke border = {{-0.003, 0.002, 0.0405}, {0, 0.004, 0}, 200, 220, 0.004};
    const double there = differ(&border, &followed);
    print_message("  on the border, laid open: off by %.2f %% of the peak, %d of 600 substeps followed\n", 100 * there,
                  followed);
    assert_true(there < 0.05);
    assert_true(followed > 50 && followed < 250); /* not behind the cut */
}

/* --- snapshots --- */

/* A snapshot of any substep of a reuse interval continues in a world with another history. */
static void snapshot_within_an_interval_continues_identically(void **state) {
    (void)state;
    const tm_tool_pose above = {.tip_m = {-0.018, 0.003, 0.05}, .active = true};
    hybrid_set a = set_touched(&above), b = set_touched(&above);
    tm_error error;
    tm_tool_pose at = {.tip_m = {-0.018, 0.003, 0.0405}, .active = true};
    int32_t inside = 0;
    set_go(&a, &at, 0.1, NULL);
    set_go(&b, &above, 0.03, NULL);
    for (int when = 0; when < 12; when++) {
        inside += a.hybrid->reuse->age > 0;
        const int64_t bytes = tm_snapshot_bytes(a.world);
        void *kept = malloc((size_t)bytes);
        fix_ok(tm_snapshot_save(a.world, kept, bytes, &error), &error);
        fix_ok(tm_snapshot_restore(b.world, kept, bytes, &error), &error);
        for (int step = 0; step < 30; step++) {
            double force[2][3];
            at.tip_m[step % 2] += 2e-5;
            substep(&a, &at, false, force[0]);
            substep(&b, &at, false, force[1]);
            assert_memory_equal(force[0], force[1], 24);
            assert_int_equal(a.hybrid->reuse->age, b.hybrid->reuse->age);
        }
        assert_true(tm_world_hash(a.world) == tm_world_hash(b.world));
        free(kept);
        for (int step = 0; step < 1 + when % 5; step++) substep(&a, &at, false, NULL);
    }
    assert_true(inside > 4);
    set_free(&a), set_free(&b);
}

/* A failed step rolls the reuse interval back. */
static void failed_step_restores_the_interval(void **state) {
    (void)state;
    const tm_tool_pose at = {.tip_m = {-0.018, 0.003, 0.0405}, .active = true};
    hybrid_set s = set_touched(&at);
    tm_error error;
    const double g[3] = {1e12, 0, 0};
    set_go(&s, &at, 0.1, NULL);
    while (s.hybrid->reuse->age < 2) substep(&s, &at, false, NULL);
    const int64_t bytes = tm_snapshot_bytes(s.world);
    char *good = malloc((size_t)bytes), *after = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(s.world, good, bytes, &error), &error);
    fix_ok(tm_stage_gravity(s.world, g, &error), &error);
    assert_int_equal(tm_world_step(s.world, 400), TM_ERR_UNSTABLE);
    fix_ok(tm_world_remove_stage(s.world, "gravity", &error), &error);
    assert_int_equal(tm_snapshot_bytes(s.world), bytes);
    fix_ok(tm_snapshot_save(s.world, after, bytes, &error), &error);
    assert_memory_equal(good, after, (size_t)bytes);
    free(good), free(after);
    set_free(&s);
}

/* A tool that is moved away from its loaded rows and back: reuse keeps none of them. */
static void tool_moved_away_and_back_reuses_no_row(void **state) {
    (void)state;
    const tm_tool_pose at = {.tip_m = {-0.018, 0.003, 0.0405}, .active = true},
                       far = {.tip_m = {-0.018, 0.003, 0.12}, .active = true};
    hybrid_set s = set_touched(&at);
    const tms_contact_solver *l = &s.hybrid->solver_contact;
    double first[3], again[3];
    set_go(&s, &at, 0.5, first);
    assert_true(l->previous_count > 0 && first[2] > 0.05);
    tm_contact_set_pose(s.contact, 0, &far);
    for (int step = 0; step < 2 * TMS_REUSE_MAX; step++) {
        substep(&s, &far, false, again);
        assert_int_equal(l->previous_count, 0);
        assert_true(fix_largest(again, 3) == 0);
    }
    assert_int_equal(s.hybrid->reuse->length, TMS_REUSE_MAX);
    tm_contact_set_pose(s.contact, 0, &at);
    set_go(&s, &at, 0.8, again);
    assert_true(off(first, again) < 1e-6 * first[2]);
    set_free(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(row_force_equals_its_contact_compliance),
                                       cmocka_unit_test(tool_at_rest_has_the_longest_interval),
                                       cmocka_unit_test(moving_contact_stays_close_to_full_solves),
                                       cmocka_unit_test(steady_slide_lengthens_intervals),
                                       cmocka_unit_test(surroundings_are_kept_while_nothing_comes_near),
                                       cmocka_unit_test(oscillating_tissue_misses_no_row),
                                       cmocka_unit_test(tool_keeps_its_force_at_the_end_of_an_interval),
                                       cmocka_unit_test(light_remnant_is_detected_in_every_substep),
                                       cmocka_unit_test(snapshot_within_an_interval_continues_identically),
                                       cmocka_unit_test(failed_step_restores_the_interval),
                                       cmocka_unit_test(tool_moved_away_and_back_reuses_no_row)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
