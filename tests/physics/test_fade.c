/* Fading cuts: the force of a removed tetrahedron falls over `fade_s` instead of within one substep. */
#include "../cut_check.h"
#include "contact_scene.h"
#include "cut/cut_internal.h"

enum { CAUTERY = 0, PROBE = 1, FRAMES = 30 };
static const double FRAME_S = 0.01, FADE_S = 0.05;

static scene fading_scene(double fade_s, int32_t threads) {
    scene_def def = scene_def_default();
    if (threads == 1) def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    if (threads != 1) def.cells[0] = def.cells[1] = 17, def.cells[2] = 10;
    def.tools = 2, def.threads = threads;
    scene s = scene_create_full(&def, true, (const tm_tool_mode[2]){TM_TOOL_CAUTERY, TM_TOOL_PROBE});
    tm_cut_def cut = tm_cut_def_default();
    cut.rate_1_s = 150, cut.loose = TM_LOOSE_REMOVE, cut.fade_s = fade_s;
    tm_error error;
    fix_ok(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
    fix_ok(tm_stage_energy(s.world, &error), &error);
    return s;
}

static tm_tool_pose cautery_at(double i) {
    return scene_pose(0.012 - 0.0008 * fmax(i - 12, 0), 0.005, 0.046 - 0.0006 * i);
}

/* Runs a frame: the cautery moves down and, cutting, sideways. Returns the largest change of its force in a substep,
 * N. */
static double cut_frame(scene *s, int i, double *most_N) {
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(s->world));
    tm_tool_pose to = cautery_at(i);
    double before[3], jump_N = 0;
    to.active = i >= 12;
    tm_contact_begin_frame(s->contact, substeps, 1);
    tm_contact_set_target(s->contact, CAUTERY, &to, substeps);
    for (int32_t k = 0; k < substeps; k++) {
        memcpy(before, s->contact->tool[CAUTERY].substep_force_N, sizeof before);
        assert_int_equal(tm_world_step(s->world, 1), TM_OK);
        const double *now = s->contact->tool[CAUTERY].substep_force_N;
        const double change[3] = {now[0] - before[0], now[1] - before[1], now[2] - before[2]};
        jump_N = fmax(jump_N, sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2]));
        *most_N = fmax(*most_N, sqrt(now[0] * now[0] + now[1] * now[1] + now[2] * now[2]));
    }
    return jump_N;
}

/* Returns the largest jump in a substep over the largest force. */
static double cut_along(scene *s, int from, int to) {
    double jump_N = 0, most_N = 0;
    for (int i = from; i < to; i++) jump_N = fmax(jump_N, cut_frame(s, i, &most_N));
    return jump_N / most_N;
}

static void force_of_removed_tissue_falls_evenly(void **state) {
    (void)state;
    double jump[2];
    for (int k = 0; k < 2; k++) {
        scene s = fading_scene(k ? FADE_S : 0, 1);
        jump[k] = cut_along(&s, 0, FRAMES);
        const int32_t cut = s.mesh->tet_count - tm_tissue_alive_count(s.tissue);
        assert_true(cut > 15);
        scene_destroy(&s);
    }
    print_message("  largest jump in a substep %.0f %% of the peak, fading %.0f %%\n", 100 * jump[0], 100 * jump[1]);
    assert_true(jump[1] < 0.5 * jump[0]);
}

/* Tissue is cut at once and exactly; after all has faded no trace is left. */
static void remaining_tissue_equals_a_fresh_build(void **state) {
    (void)state;
    scene s = fading_scene(FADE_S, 1);
    cut_along(&s, 0, 20);
    assert_true(s.contact->fading->count > 0);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = s.mesh, def.material_count = 1, def.material = &s.material, def.cuttable = true;
    cut_same_bits(s.tissue, &def);
    tm_tool_pose still = cautery_at(19);
    still.active = false;
    for (int i = 0; i < 6; i++) scene_frame(&s, CAUTERY, still, FRAME_S);
    assert_int_equal(s.contact->fading->count, 0);
    scene_destroy(&s);
}

static void energy_is_accounted_for(void **state) {
    (void)state;
    scene s = fading_scene(FADE_S, 1);
    tm_energy e;
    double turned_J = 0, most_N = 0;
    int32_t faded = 0;
    for (int i = 0; i < FRAMES; i++) {
        cut_frame(&s, i, &most_N);
        faded += s.contact->fading->count;
        assert_int_equal(tm_world_energy(s.world, &e, NULL), TM_OK);
        turned_J = fmax(turned_J, fabs(e.tool_work_J[CAUTERY]) + fabs(e.contact_J[CAUTERY]) + fabs(e.cut_J));
    }
    print_message("  residual %.1e J of %.2e J turned over, made %.1e J\n", e.residual_J, turned_J, e.generated_J);
    assert_true(faded > 20);
    assert_true(fabs(e.residual_J) < 1e-11 * turned_J);
    assert_true(e.generated_J < 0);
    scene_destroy(&s);
}

/* A fading force only decreases: it does not follow a tool that moves back, and ends if the tool is set elsewhere. */
static void fading_force_never_drives_the_tool(void **state) {
    (void)state;
    scene s = fading_scene(10, 1); /* practically never fades */
    double most_N = 0;
    cut_along(&s, 0, 20);
    assert_true(s.contact->fading->count > 0);
    tm_energy cut, out;
    assert_int_equal(tm_world_energy(s.world, &cut, NULL), TM_OK);
    for (int i = 19; i >= 0; i--) {
        tm_tool_pose back = cautery_at(i);
        back.active = false;
        const tm_tool_reaction r = scene_frame(&s, CAUTERY, back, FRAME_S);
        most_N = fmax(most_N, fabs(r.force_N[2]));
    }
    assert_int_equal(tm_world_energy(s.world, &out, NULL), TM_OK);
    assert_true(s.contact->fading->count > 0 && most_N > 0);
    for (int c = 0; c < 3; c++) assert_true(tm_contact_reaction(s.contact, CAUTERY).force_N[c] == 0);
    print_message("  springs and tissue %.2e J, hand got back %.2e J\n",
                  cut.elastic_J + cut.kinetic_J + cut.contact_stored_J,
                  cut.tool_work_J[CAUTERY] - out.tool_work_J[CAUTERY]);
    assert_true(cut.tool_work_J[CAUTERY] - out.tool_work_J[CAUTERY] <
                cut.elastic_J + cut.kinetic_J + cut.contact_stored_J);
    const tm_tool_pose away = scene_pose(0.01, 0.005, 0.1);
    tm_contact_set_pose(s.contact, CAUTERY, &away);
    assert_int_equal(s.contact->fading->count, 0);
    scene_destroy(&s);
}

/* No stiffness or patch is sent while a force fades, as they do not include it; before and after they are sent. */
static void no_stiffness_while_it_fades(void **state) {
    (void)state;
    scene s = fading_scene(FADE_S, 1);
    tm_patch_def def = tm_patch_def_default();
    def.iterations = 4000; /* all columns in one call, after each cut too */
    tm_patch_builder *maker;
    tm_error error;
    fix_ok(tm_stage_patch(s.world, s.contact, &def, &maker, &error), &error);
    tm_patch patch;
    double most_N = 0;
    int fades = 0, before = 0, after = 0;
    for (int i = 0; i < 20; i++) {
        cut_frame(&s, i, &most_N);
        const bool fading = s.contact->fading->count > 0, made = tm_patch_compute(maker, CAUTERY, &patch);
        const int32_t kind = tm_contact_reaction(s.contact, CAUTERY).stiffness_kind;
        assert_true(made == (kind != 0) && made == (patch.kind != 0));
        assert_false(fading && made);
        fades += fading, before += made;
    }
    tm_tool_pose still = cautery_at(19);
    still.active = false;
    for (int i = 0; i < 8; i++) {
        scene_frame(&s, CAUTERY, still, FRAME_S);
        after += s.contact->fading->count == 0 && tm_patch_compute(maker, CAUTERY, &patch);
    }
    print_message("  no stiffness in %d frames, before them in %d, after them in %d\n", fades, before, after);
    assert_true(fades > 3 && before > 3 && after > 0);
    scene_destroy(&s);
}

static uint64_t hash_of(scene *s) {
    const double *force = s->contact->tool[CAUTERY].substep_force_N;
    return tm_hash(force, 3 * sizeof *force, tm_world_hash(s->world));
}

static void snapshots_and_threads_keep_the_bits(void **state) {
    (void)state;
    scene s = fading_scene(FADE_S, 2), one = fading_scene(FADE_S, 0);
    tm_error error;
    cut_along(&s, 0, 18);
    cut_along(&one, 0, 18);
    assert_true(s.contact->fading->count > 0);
    assert_true(hash_of(&s) == hash_of(&one));
    const int64_t bytes = tm_snapshot_bytes(s.world);
    void *kept = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(s.world, kept, bytes, &error), &error);
    cut_along(&s, 18, 22);
    cut_along(&one, 18, 20); /* has a different state */
    fix_ok(tm_snapshot_restore(one.world, kept, bytes, &error), &error);
    cut_along(&one, 18, 22);
    assert_true(hash_of(&s) == hash_of(&one));
    scene_destroy(&one);
    one = fading_scene(0, 1); /* worlds that cannot store such rows refuse them */
    assert_int_not_equal(tm_snapshot_restore(one.world, kept, bytes, &error), TM_OK);
    scene_destroy(&one);
    scene_destroy(&s);
    free(kept);
}

static void bad_fades_are_refused(void **state) {
    (void)state;
    static const double bad[] = {-1e-9, (double)INFINITY, (double)NAN};
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = def.cells[2] = 2;
    scene s = scene_create_full(&def, true, NULL);
    for (int i = 0; i < 3; i++) {
        tm_cut_def cut = tm_cut_def_default();
        tm_error error;
        cut.fade_s = bad[i];
        assert_int_equal(tm_stage_cut(s.world, s.contact, &cut, &error), TM_ERR_ARGUMENT);
        assert_non_null(strstr(error.message, "; "));
    }
    assert_null(s.contact->fading);
    scene_destroy(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(force_of_removed_tissue_falls_evenly),
                                       cmocka_unit_test(remaining_tissue_equals_a_fresh_build),
                                       cmocka_unit_test(energy_is_accounted_for),
                                       cmocka_unit_test(fading_force_never_drives_the_tool),
                                       cmocka_unit_test(no_stiffness_while_it_fades),
                                       cmocka_unit_test(snapshots_and_threads_keep_the_bits),
                                       cmocka_unit_test(bad_fades_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
