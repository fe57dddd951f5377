/* Partition ends: for any ends, and any task that overlaps the force pass, a step is bit-identical to one thread;
 * the ends move to balance the threads' times. make sanitize runs it under ThreadSanitizer. */
#include "../fixture.h"
#include "../long.h"
#include "contact/contact_internal.h"
#include "contact_scene.h"
#include "world/world_internal.h"

enum { FRAMES = 5, SUBSTEPS = 40, CAUTERY = 0, GRASPER = 1 };
static const int32_t THREADS[] = {2, 3, 8};

static scene create(tm_force_form form, int32_t threads) {
    scene s = scene_create_divided(form, TM_DOUBLE, threads, NULL);
    assert_int_equal(tm_world_partitions(s.world), threads);
    return s;
}

/* Any ends, including partitions of one vertex and of none. */
static void set_anywhere(tm_world *world, fix_random *random) {
    const int32_t n = tm_tissue_mesh(tm_world_tissue(world))->vertex_count, count = tm_world_partitions(world);
    int32_t end[TM_MAX_THREADS];
    for (int32_t p = 0; p < count; p++) {
        end[p] = p + 1 == count ? n : (int32_t)(fix_uniform(random) * n);
        for (int32_t q = p; q > 0 && end[q] < end[q - 1]; q--) {
            const int32_t swap = end[q];
            end[q] = end[q - 1], end[q - 1] = swap;
        }
    }
    if (count > 2) end[1] = end[0] + (fix_uniform(random) < 0.5);
    if (count > 2 && end[1] > end[2]) end[1] = end[0];
    tm_partition_set_ends(world, end);
}

static void play(scene *s, bool moves, uint64_t hash[FRAMES]) {
    fix_random random = {11};
    for (int i = 0; i < FRAMES; i++) {
        const tm_tool_pose burn = scene_pose(0.012, 0.005, 0.046 - 0.004 * i);
        tm_tool_pose jaw = scene_pose(-0.012, -0.003, 0.044);
        jaw.grip = i > 1 && i < FRAMES - 1;
        tm_contact_begin_frame(s->contact, SUBSTEPS, SUBSTEPS);
        tm_contact_set_target(s->contact, CAUTERY, &burn, SUBSTEPS);
        tm_contact_set_target(s->contact, GRASPER, &jaw, SUBSTEPS);
        for (int k = 0; k < SUBSTEPS; k += SUBSTEPS / 4) {
            if (moves) set_anywhere(s->world, &random);
            assert_int_equal(tm_world_step(s->world, SUBSTEPS / 4), TM_OK);
        }
        const tm_tool_reaction reaction = tm_contact_reaction(s->contact, CAUTERY);
        hash[i] = tm_hash(reaction.force_N, sizeof reaction.force_N, tm_world_hash(s->world));
        hash[i] = tm_hash(tm_world_state(s->world)->force_N, 24 * (size_t)s->mesh->vertex_count, hash[i]);
    }
    assert_true(tm_tissue_alive_count(s->tissue) < s->mesh->tet_count);
}

static void any_partition_ends_give_the_same_bits(void **state) {
    (void)state;
    for (int form = 0; form < 2; form++) {
        uint64_t one[FRAMES], many[FRAMES];
        scene s;
        if (!test_watches_threads()) {
            s = create(form ? TM_FORCE_PLAIN : TM_FORCE_BEST, 1);
            play(&s, false, one);
            scene_destroy(&s);
        }
        for (int t = test_is_sanitized() ? 1 + form : 0; t < (test_is_sanitized() ? 2 + form : 3); t++) {
            s = create(form ? TM_FORCE_PLAIN : TM_FORCE_BEST, THREADS[t]);
            play(&s, true, many);
            scene_destroy(&s);
            if (!test_watches_threads()) assert_memory_equal(many, one, sizeof one);
        }
    }
}

/* A stage between force and the new displacements sees the same tool poses, whichever task overlaps. */
static void note(void *self, tm_world *world) {
    uint64_t *hash = self;
    const tm_tool_pose pose = tm_contact_pose(tm_world_contact(world), CAUTERY);
    *hash = tm_hash(pose.tip_m, sizeof pose.tip_m, *hash);
}
static void note_range(void *self, tm_world *world, const tm_range *range) {
    if (range->begin == 0) note(self, world);
}

static void stages_see_the_same_tool_poses_for_any_threads(void **state) {
    (void)state;
    for (int kind = 0; kind < 2; kind++) {
        uint64_t seen[2] = {TM_HASH_SEED, TM_HASH_SEED}, hash[2][FRAMES];
        for (int many = test_watches_threads() ? 1 : 0; many < 2; many++) {
            scene s = create(TM_FORCE_BEST, many ? 3 : 1);
            tm_error error;
            const tm_stage stage = {.size = sizeof stage,
                                    .name = "notes",
                                    .phase = TM_PHASE_LOAD,
                                    .run = kind ? NULL : note,
                                    .range = kind ? note_range : NULL,
                                    .self = seen + many};
            fix_ok(tm_world_add_stage(s.world, &stage, 0, &error), &error);
            play(&s, false, hash[many]);
            scene_destroy(&s);
        }
        if (test_watches_threads()) continue;
        assert_true(seen[0] == seen[1]);
        assert_memory_equal(hash[0], hash[1], sizeof hash[0]);
    }
}

/* A caller's stage may overlap the force pass and set a tool's pose before contact detection. */
static void place(void *self, tm_world *world) {
    int32_t *runs = self;
    if (++*runs % 16) return;
    tm_tool_pose pose = tm_contact_pose(tm_world_contact(world), CAUTERY);
    pose.tip_m[0] -= 4e-4;
    tm_contact_set_pose(tm_world_contact(world), CAUTERY, &pose);
}
static bool begin_nothing(void *self, tm_world *world) { return (void)self, (void)world, false; }
static void work_nothing(void *self, tm_world *world, int32_t part) { (void)self, (void)world, (void)part; }

static void pose_set_before_detection_is_detected(void **state) {
    (void)state;
    static const tm_overlap nothing = {begin_nothing, work_nothing};
    uint64_t hash[2][FRAMES];
    for (int many = test_watches_threads() ? 1 : 0; many < 2; many++) {
        scene s = create(TM_FORCE_BEST, many ? 3 : 1);
        tm_error error;
        int32_t runs = 0;
        const tm_stage stage = {.size = sizeof stage,
                                .name = "place",
                                .phase = TM_PHASE_CONSTRAIN,
                                .run = place,
                                .self = &runs,
                                .runs_before = TM_STAGE_CONTACT_DETECT,
                                .overlap = &nothing};
        fix_ok(tm_world_add_stage(s.world, &stage, 0, &error), &error);
        play(&s, false, hash[many]);
        scene_destroy(&s);
    }
    if (!test_watches_threads()) assert_memory_equal(hash[0], hash[1], sizeof hash[0]);
}

/* --- checks after the force pass --- */

static int32_t first_of_contact(const scene *s) {
    int32_t i = 0;
    while (s->world->entry[i].stage.phase != TM_PHASE_CONSTRAIN || s->world->entry[i].stage.self != s->contact) i++;
    return i;
}

static bool is_missed(tm_world *world, int32_t first, int32_t vertex) {
    double *at = world->state.u_next_m + 3 * vertex + 1;
    static const double NOWHERE[] = {NAN, INFINITY, -1e7};
    const double was = *at;
    bool missed = false;
    for (int i = 0; i < 3; i++) {
        *at = NOWHERE[i];
        missed |= tm_world_few_are_bounded(world, first);
    }
    *at = was;
    return missed;
}

/* Vertices of contact and grasps are checked again; after a later stage that may write anywhere, all are. */
static void changed_vertices_are_checked_again(void **state) {
    (void)state;
    scene s = create(TM_FORCE_BEST, 2);
    tm_world *world = s.world;
    tm_contact_begin_frame(s.contact, SUBSTEPS, SUBSTEPS);
    tm_contact_set_target(s.contact, CAUTERY, &(tm_tool_pose){.tip_m = {0.012, 0.005, 0.0445}, .active = true},
                          SUBSTEPS);
    for (int grip = 0; grip < 2; grip++) {
        tm_tool_pose jaw = scene_pose(-0.012, -0.003, 0.044);
        jaw.grip = grip;
        tm_contact_set_target(s.contact, GRASPER, &jaw, SUBSTEPS);
        assert_int_equal(tm_world_step(world, SUBSTEPS), TM_OK);
    }
    const tm_contact_row *row;
    const int32_t rows = tm_contact_rows(s.contact, &row);
    const tm_jaw_load load = tm_contact_load(s.contact, GRASPER);
    assert_true(rows > 0 && load.count > 3);
    const int32_t first = first_of_contact(&s);
    assert_true(tm_world_few_are_bounded(world, first));
    for (int32_t i = 0; i < 3 * rows; i++) assert_false(is_missed(world, first, row[i / 3].vertex[i % 3]));
    for (int32_t i = 0; i < load.count; i++) assert_false(is_missed(world, first, load.vertex[i]));
    assert_true(tm_world_changes_few(world, first));
    tm_error error;
    uint64_t seen = 0;
    const tm_stage stage = {.size = sizeof stage, .name = "notes", .phase = TM_PHASE_END, .run = note, .self = &seen};
    fix_ok(tm_world_add_stage(world, &stage, 0, &error), &error);
    assert_false(tm_world_changes_few(world, first));
    scene_destroy(&s);
}

/* --- where the ends move --- */

static void book(tm_world *world, int32_t jobs, const double *took_s) {
    for (int32_t i = 0; i < jobs; i++) {
        for (int32_t p = 0; p < tm_world_partitions(world); p++)
            tm_partition_record_time(world->partition + p, took_s[p]);
        tm_rebalance(world);
    }
}

static int32_t size_of(const tm_world *world, int32_t p) {
    return world->partition[p].force.end - world->partition[p].force.begin;
}

static void ends_move_to_balance_the_times(void **state) {
    (void)state;
    enum { EVERY = 32 };
    scene s = create(TM_FORCE_BEST, 3);
    tm_world *world = s.world;
    const int32_t n = s.mesh->vertex_count, first = size_of(world, 0), last = size_of(world, 2);
    book(world, EVERY, (double[]){10e-6, 10e-6, 10e-6}); /* equal: nothing moves */
    assert_int_equal(size_of(world, 0), first);
    assert_int_equal(size_of(world, 2), last);
    book(world, EVERY - 1, (double[]){10e-6, 10e-6, 10e-6}); /* one thread was interrupted once: hardly any change */
    book(world, 1, (double[]){10e-6, 10e-6, 5e-3});
    assert_true(size_of(world, 2) > 0.95 * last);
    book(world, EVERY, (double[]){10e-6, 10e-6, 10e-6});
    book(world, EVERY, (double[]){14e-6, 10e-6, 6e-6}); /* it detects contact concurrently */
    assert_true(size_of(world, 0) < 0.9 * first && size_of(world, 2) > 1.1 * last);
    for (int i = 0; i < 40; i++)
        book(world, EVERY, (double[]){20e-6, 1e-6, 1e-6}); /* however short its partition becomes: empty */
    assert_int_equal(size_of(world, 0), 0);
    assert_int_equal(world->partition[2].force.end, n);
    for (int i = 0; i < 400; i++) { /* and back, in proportion to its share */
        double took_s[3];
        for (int32_t p = 0; p < 3; p++) took_s[p] = 30e-6 * size_of(world, p) / n;
        book(world, EVERY, took_s);
    }
    for (int32_t p = 0; p < 3; p++) assert_true(fabs(size_of(world, p) - n / 3.0) < 0.04 * n);
    assert_int_equal(tm_world_step(world, 4), TM_OK);
    scene_destroy(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(any_partition_ends_give_the_same_bits),
                                       cmocka_unit_test(stages_see_the_same_tool_poses_for_any_threads),
                                       cmocka_unit_test(pose_set_before_detection_is_detected),
                                       cmocka_unit_test(changed_vertices_are_checked_again),
                                       cmocka_unit_test(ends_move_to_balance_the_times)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
