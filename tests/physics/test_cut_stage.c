/* The "cut" stage in a world with contact: rate, detached fragments, removed tetrahedra; and snapshots of all of it. */
#include "../cut_check.h"
#include "contact_scene.h"
#include "cut/cut_internal.h"

enum { CAUTERY = 0, PROBE = 1 };
static const double FRAME_S = 0.01;

static scene cutting_scene(double rate_1_s, tm_cut_loose loose) {
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 8, def.cells[2] = 5;
    def.tools = 2;
    scene s = scene_create_full(&def, true, (const tm_tool_mode[2]){TM_TOOL_CAUTERY, TM_TOOL_PROBE});
    tm_cut_def cut = tm_cut_def_default();
    cut.rate_1_s = rate_1_s, cut.loose = loose;
    tm_error error;
    fix_ok(tm_stage_gravity(s.world, (const double[3]){0, 0, -9.81}, &error), &error);
    fix_ok(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
    return s;
}

/* Runs frame `i` of a fixed sequence: the cautery moves down and sideways while the probe presses. */
static void story(scene *s, int i, bool active) {
    tm_tool_pose tool = scene_pose(0.012 + 0.0004 * i, 0.005, 0.05 - 0.0008 * (i < 25 ? i : 25));
    tool.active = active;
    tm_contact_set_target(s->contact, CAUTERY, &tool, (int32_t)ceil(FRAME_S / tm_world_step_s(s->world)));
    scene_frame(s, PROBE, scene_pose(-0.012, 0.005, 0.05 - 0.0005 * (i < 30 ? i : 30)), FRAME_S);
}

static void cautery_cuts_at_its_rate(void **state) {
    (void)state;
    const double rate = 150;
    scene s = cutting_scene(rate, TM_LOOSE_FALL);
    int32_t tets = s.mesh->tet_count, tet[512], touched = 0, cut = 0;
    int8_t who[512];
    for (int i = 0; i < 60; i++) story(&s, i, false);
    assert_int_equal(tm_tissue_alive_count(s.tissue), tets); /* without current it is a probe */
    assert_true(tm_contact_reaction(s.contact, CAUTERY).row_count > 0);
    for (int i = 0; i < 60; i++) {
        const int32_t before = tm_tissue_alive_count(s.tissue);
        story(&s, i, true);
        touched += tm_contact_reaction(s.contact, CAUTERY).row_count > 0;
        const int32_t n = tm_cut_fetch_removed(s.world, tet, who, 512);
        assert_int_equal(n, before - tm_tissue_alive_count(s.tissue));
        for (int32_t k = 0; k < n; k++) {
            assert_false(tm_tissue_alive(s.tissue)[tet[k]]);
            cut += who[k] == CAUTERY;
            assert_true(who[k] == CAUTERY || who[k] == -1);
        }
    }
    print_message("  %d cut in %d frames of touch at %g/s\n", cut, touched, rate);
    assert_true(touched > 5 && cut > 0.3 * rate * touched * FRAME_S);
    assert_true(cut < 2.5 * rate * (touched + 2) * FRAME_S); /* repair removes some more */
    assert_null(cut_not_manifold(s.tissue));
    assert_int_equal(tm_cut_fetch_removed(s.world, tet, NULL, 512), 0);
    scene_destroy(&s);
}

/* A slab in the middle is removed, so the top has no support. */
static int32_t cut_the_top_off(scene *s, double from_m, double to_m) {
    int32_t *tet = malloc(sizeof(int32_t) * (size_t)s->mesh->tet_count), n = 0, above = 0;
    for (int32_t t = 0; t < s->mesh->tet_count; t++) {
        double low = 1, high = 0;
        for (int i = 0; i < 4; i++) {
            const double z = s->mesh->rest_m[3 * s->mesh->tet[4 * t + i] + 2];
            low = fmin(low, z), high = fmax(high, z);
        }
        if (high > from_m && low < to_m) tet[n++] = t;
        above += low >= to_m;
    }
    assert_true(n > 0 && above > 0);
    tm_cut_remove(s->tissue, tet, n, NULL, 0);
    free(tet);
    return above;
}

static void detached_fragments_are_removed(void **state) {
    (void)state;
    for (tm_cut_loose loose = TM_LOOSE_FALL; loose <= TM_LOOSE_REMOVE; loose++) {
        scene s = cutting_scene(100, loose);
        story(&s, 0, false);
        const int32_t above = cut_the_top_off(&s, 0.02, 0.026), left = tm_tissue_alive_count(s.tissue) - above;
        double lowest = 0;
        int32_t fallen_at = -1, steps = 0;
        for (; steps < 60000 && tm_tissue_alive_count(s.tissue) > left; steps += 100) {
            assert_int_equal(tm_world_step(s.world, 100), TM_OK);
            for (int32_t v = 0; v < s.mesh->vertex_count; v++)
                if (tm_tissue_mass_kg(s.tissue)[v] > 0) lowest = fmin(lowest, tm_world_state(s.world)->u_m[3 * v + 2]);
            if (fallen_at < 0 && lowest < -0.03) fallen_at = steps;
        }
        assert_int_equal(tm_tissue_alive_count(s.tissue), left); /* the others still have support */
        int32_t *tet = malloc(sizeof(int32_t) * (size_t)s.mesh->tet_count);
        int8_t *who = malloc((size_t)s.mesh->tet_count);
        const int32_t n = tm_cut_fetch_removed(s.world, tet, who, s.mesh->tet_count);
        assert_int_equal(n, above);
        for (int32_t i = 0; i < n; i++) assert_int_equal(who[i], -1);
        free(tet), free(who);
        if (loose == TM_LOOSE_REMOVE)
            assert_true(steps <= 1000 && fallen_at < 0);
        else
            assert_true(fallen_at > 0 && steps > fallen_at);
        scene_destroy(&s);
    }
}

/* No substep of the search visits more than its limit, for any size of mesh; starting a search costs no more. */
static void search_is_spread_over_substeps(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 20, def.cells[2] = 6, def.tools = 2;
    scene s = scene_create_full(&def, true, (const tm_tool_mode[2]){TM_TOOL_CAUTERY, TM_TOOL_PROBE});
    const tm_cut_def cut = tm_cut_def_default();
    tm_error error;
    fix_ok(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
    assert_int_equal(tm_world_step(s.world, 2), TM_OK);
    assert_int_equal(tm_cut_max_visits(s.world), 0); /* nothing was cut */
    for (int32_t i = 0; i < 3; i++) {                /* three searches, each to its end */
        const int32_t tet = 7000 + 100 * i;
        assert_true(tm_cut_remove(s.tissue, &tet, 1, NULL, 0) > 0);
        assert_int_equal(tm_world_step(s.world, 100), TM_OK);
    }
    print_message("  %d tetrahedra, at most %d looked at in a substep\n", s.mesh->tet_count,
                  tm_cut_max_visits(s.world));
    assert_true(s.mesh->tet_count > 7 * 2048);
    assert_in_range(tm_cut_max_visits(s.world), 1024, 2048);
    scene_destroy(&s);
}

static uint64_t run_on(scene *s, int from, int to) {
    for (int i = from; i < to; i++) story(s, i, true);
    const tm_surface_view surface = tm_tissue_surface(s->tissue);
    const tm_tool_reaction reaction = tm_contact_reaction(s->contact, PROBE);
    uint64_t h = tm_hash(surface.triangle, sizeof(int32_t) * 3 * (size_t)surface.count, tm_world_hash(s->world));
    h = tm_hash(reaction.force_N, sizeof reaction.force_N, h);
    return tm_hash(tm_tissue_alive(s->tissue), (size_t)s->mesh->tet_count, h);
}

static void snapshot_goes_on_with_the_same_bits(void **state) {
    (void)state;
    scene s = cutting_scene(300, TM_LOOSE_REMOVE);
    tm_error error;
    run_on(&s, 0, 30);
    assert_true(tm_tissue_alive_count(s.tissue) < s.mesh->tet_count);
    assert_true(tm_contact_reaction(s.contact, PROBE).row_count > 0);
    const int64_t bytes = tm_snapshot_bytes(s.world);
    void *kept = malloc((size_t)bytes), *again = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(s.world, kept, bytes, &error), &error);
    assert_int_equal(tm_snapshot_save(s.world, kept, bytes - 1, &error), TM_ERR_ARGUMENT);
    const int32_t alive = tm_tissue_alive_count(s.tissue);
    const uint64_t hash = run_on(&s, 30, 45);
    assert_true(tm_tissue_alive_count(s.tissue) < alive);
    /* Restores it in the same world, and in another one with a different state. */
    fix_ok(tm_snapshot_restore(s.world, kept, bytes, &error), &error);
    assert_int_equal(tm_tissue_alive_count(s.tissue), alive);
    assert_int_equal(tm_snapshot_bytes(s.world), bytes);
    fix_ok(tm_snapshot_save(s.world, again, bytes, &error), &error);
    assert_memory_equal(kept, again, (size_t)bytes);
    assert_true(run_on(&s, 30, 45) == hash);
    scene other = cutting_scene(300, TM_LOOSE_REMOVE);
    run_on(&other, 3, 6);
    fix_ok(tm_snapshot_restore(other.world, kept, bytes, &error), &error);
    assert_true(run_on(&other, 30, 45) == hash);
    scene_destroy(&other);
    scene_destroy(&s);
    free(kept), free(again);
}

static void snapshots_that_do_not_fit_are_rejected(void **state) {
    (void)state;
    scene s = cutting_scene(300, TM_LOOSE_REMOVE);
    tm_error error;
    run_on(&s, 0, 28);
    const int64_t bytes = tm_snapshot_bytes(s.world);
    char *kept = malloc((size_t)bytes + 8);
    fix_ok(tm_snapshot_save(s.world, kept, bytes, &error), &error);
    const uint64_t hash = run_on(&s, 28, 30);
    const int32_t alive = tm_tissue_alive_count(s.tissue);
    fix_random random = {1};
    for (int i = 0; i < 300; i++) { /* one wrong bit, anywhere */
        const int64_t at = i < 80 ? i : (int64_t)(fix_uniform(&random) * (double)bytes);
        kept[at] = (char)(kept[at] ^ 1 << i % 8);
        assert_int_equal(tm_snapshot_restore(s.world, kept, bytes, &error), TM_ERR_FILE);
        kept[at] = (char)(kept[at] ^ 1 << i % 8);
    }
    for (int64_t cut = 0; cut < bytes; cut += cut < 100 ? 1 : 4001)
        assert_int_equal(tm_snapshot_restore(s.world, kept, cut, &error), TM_ERR_FILE);
    assert_int_equal(tm_snapshot_restore(s.world, kept, bytes + 8, &error), TM_ERR_FILE);
    assert_int_equal(tm_snapshot_restore(s.world, kept + 1, bytes, &error), TM_ERR_ARGUMENT);
    /* Other materials, other stages. */
    scene_def def = s.def;
    scene other = scene_create_full(&def, true, NULL);
    assert_int_equal(tm_snapshot_restore(other.world, kept, bytes, &error), TM_ERR_ARGUMENT);
    scene_destroy(&other);
    def.young_Pa *= 2;
    other = scene_create_full(&def, true, NULL);
    assert_int_equal(tm_snapshot_restore(other.world, kept, bytes, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "; "));
    scene_destroy(&other);
    assert_int_equal(tm_tissue_alive_count(s.tissue), alive); /* nothing was touched */
    fix_ok(tm_snapshot_restore(s.world, kept, bytes, &error), &error);
    assert_true(run_on(&s, 28, 30) == hash);
    free(kept);
    scene_destroy(&s);
}

static void *no_alloc(size_t bytes, void *user) {
    (void)bytes, (void)user;
    fail_msg("an allocation in a step");
    return NULL;
}
static void plain_free(void *memory, size_t bytes, void *user) {
    (void)bytes, (void)user;
    free(memory);
}

static void steps_allocate_nothing(void **state) {
    (void)state;
    scene s = cutting_scene(300, TM_LOOSE_REMOVE);
    tm_set_allocator(&(tm_allocator){no_alloc, plain_free, NULL});
    run_on(&s, 0, 35);
    assert_true(tm_tissue_alive_count(s.tissue) < s.mesh->tet_count);
    tm_set_allocator(NULL);
    scene_destroy(&s);
    assert_int_equal(tm_memory_in_use(), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(cautery_cuts_at_its_rate),
                                       cmocka_unit_test(detached_fragments_are_removed),
                                       cmocka_unit_test(search_is_spread_over_substeps),
                                       cmocka_unit_test(snapshot_goes_on_with_the_same_bits),
                                       cmocka_unit_test(snapshots_that_do_not_fit_are_rejected),
                                       cmocka_unit_test(steps_allocate_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
