/* A step on several threads is bit-identical to one thread: any number, the library's or the caller's, every form of
 * the force loop, with contact, grasping and cutting, in any numbering. A failure rolls back completely. make sanitize
 * runs it under ThreadSanitizer. */
#include "../fixture.h"
#include "../long.h"
#include "contact_scene.h"
#include "material/material_internal.h"
#include "tensormass/rotation.h"
#include "tensormass/viscosity.h"
#include "world/world_internal.h"
#include <time.h>

enum { FRAMES = 6, CAUTERY = 0, GRASPER = 1 };
static const int32_t THREADS[] = {1, 2, 3, 8};

/* --- a sequence of frames --- */

static scene create(tm_force_form form, tm_precision precision, int32_t threads, tm_parallel_for *parallel_for) {
    scene s = scene_create_divided(form, precision, threads, parallel_for);
    tm_error error;
    fix_ok(tm_stage_gravity(s.world, (const double[3]){0, 0, -9.81}, &error), &error);
    assert_int_equal(tm_world_partitions(s.world), threads);
    return s;
}

/* The cautery comes in from the right, the grasper grasps at the left; stores each frame's bits. */
static void play(scene *s, uint64_t hash[FRAMES]) {
    for (int i = 0; i < FRAMES; i++) {
        const int32_t substeps = (int32_t)ceil(0.004 / tm_world_step_s(s->world));
        const tm_tool_pose burn = scene_pose(0.012, 0.005, 0.046 - 0.004 * i);
        tm_tool_pose jaw = scene_pose(-0.012, -0.003, 0.044);
        jaw.grip = i > 1;
        tm_contact_begin_frame(s->contact, substeps, substeps);
        tm_contact_set_target(s->contact, CAUTERY, &burn, substeps);
        tm_contact_set_target(s->contact, GRASPER, &jaw, substeps);
        assert_int_equal(tm_world_step(s->world, substeps), TM_OK);
        const double *force = tm_contact_reaction(s->contact, CAUTERY).force_N;
        hash[i] = tm_hash(force, 3 * sizeof *force, tm_world_hash(s->world));
        hash[i] = tm_hash(tm_world_state(s->world)->force_N, 24 * (size_t)s->mesh->vertex_count, hash[i]);
    }
    assert_true(tm_tissue_alive_count(s->tissue) < s->mesh->tet_count);
}

static void same_story(tm_force_form form, tm_precision precision, int32_t threads, tm_parallel_for *parallel_for,
                       const uint64_t expected[FRAMES]) {
    uint64_t hash[FRAMES];
    scene s = create(form, precision, threads, parallel_for);
    play(&s, hash);
    if (!test_watches_threads()) assert_memory_equal(hash, expected, sizeof hash);
    scene_destroy(&s);
}

static void bits_are_the_same_for_any_number_of_threads(void **state) {
    (void)state;
    static const struct {
        tm_force_form form;
        tm_precision precision;
    } kind[] = {{TM_FORCE_PLAIN, TM_DOUBLE}, {TM_FORCE_BEST, TM_DOUBLE}, {TM_FORCE_BEST, TM_SINGLE}};
    for (int k = 0; k < 3; k++) {
        uint64_t one[FRAMES] = {0};
        if (!test_watches_threads()) {
            scene s = create(kind[k].form, kind[k].precision, 1, NULL);
            play(&s, one);
            scene_destroy(&s);
        }
        for (int t = test_is_sanitized() ? 3 - k : 1; t < (test_is_sanitized() ? 4 - k : 4); t++)
            same_story(kind[k].form, kind[k].precision, THREADS[t], NULL, one);
    }
}

/* --- threads of the application's own --- */

static int32_t calls;

static void last_part_first(void *user, void (*work)(void *context, int32_t part), void *context, int32_t parts) {
    (void)user;
    calls++;
    for (int32_t p = parts - 1; p >= 0; p--) work(context, p);
}

static void caller_threads_give_the_same_bits(void **state) {
    (void)state;
    uint64_t one[FRAMES];
    scene s = create(TM_FORCE_BEST, TM_DOUBLE, 1, NULL);
    play(&s, one);
    scene_destroy(&s);
    calls = 0;
    same_story(TM_FORCE_BEST, TM_DOUBLE, 3, last_part_first, one);
    assert_true(calls > FRAMES);
}

/* Counts calls to the caller's threads while two tools touch, or one of them is far from the tissue. */
static int32_t calls_with(double other_tip_z) {
    enum { SUBSTEPS = 20 };
    scene s = create(TM_FORCE_BEST, TM_DOUBLE, 3, last_part_first);
    const tm_tool_pose near = scene_pose(0.012, 0.005, 0.0445), other = scene_pose(-0.012, -0.003, other_tip_z);
    tm_contact_set_pose(s.contact, CAUTERY, &near);
    tm_contact_set_pose(s.contact, GRASPER, &other);
    assert_int_equal(tm_world_step(s.world, 4), TM_OK);
    calls = 0;
    assert_int_equal(tm_world_step(s.world, SUBSTEPS), TM_OK);
    scene_destroy(&s);
    return calls / SUBSTEPS;
}

/* All tools are detected during the force pass, and each partition checks its new displacements: there are no
 * further waits. */
static void contact_detection_overlaps_the_force_pass(void **state) {
    (void)state;
    assert_int_equal(calls_with(0.0445), 1);
    assert_int_equal(calls_with(0.2), 1);
}

/* --- between steps --- */

/* The patch under a pressing tool: the same threads compute its columns. */
static void patch_made_by(int32_t threads, tm_patch *patch) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 12, d.cells[2] = 8, d.threads = threads;
    d.trocar_m[0][0] = 0.1;
    memcpy(d.tip_m[0], (double[3]){0.003, 0.004, d.size_m[2] + 0.0027}, sizeof d.tip_m[0]);
    scene s = scene_create_full(&d, false, NULL);
    tm_patch_def def = tm_patch_def_default();
    tm_patch_builder *maker = NULL;
    tm_error error;
    scene_must(tm_stage_patch(s.world, s.contact, &def, &maker, &error), &error);
    assert_int_equal(tm_world_partitions(s.world), threads);
    scene_frame(&s, 0, scene_pose(0.003, 0.004, d.size_m[2] - 0.0017), 0.02);
    memset(patch, 0, sizeof *patch);
    bool made = false;
    for (int call = 0; call < 100 && !(made && test_is_sanitized()); call++) made = tm_patch_compute(maker, 0, patch);
    assert_true(made);
    scene_destroy(&s);
}

static void patches_have_the_same_bits(void **state) {
    (void)state;
    static tm_patch one, three;
    patch_made_by(3, &three);
    if (test_watches_threads()) return;
    patch_made_by(1, &one);
    assert_memory_equal(&one, &three, sizeof one);
}

/* --- numbering --- */

/* The block with randomly numbered vertices: nearly every edge connects two partitions. */
static tm_mesh *shuffled(void) {
    fix_random random = {5};
    tm_mesh *block = fix_block((int[3]){14, 14, 14}, (double[3]){0.1, 0.1, 0.1}, 0.2, &random);
    const int32_t n = block->vertex_count;
    int32_t *number = malloc(sizeof(int32_t) * (size_t)n), *tet = malloc(16 * (size_t)block->tet_count);
    double *vertex = malloc(24 * (size_t)n);
    for (int32_t v = 0; v < n; v++) number[v] = v;
    for (int32_t v = n - 1; v > 0; v--) {
        const int32_t other = (int32_t)(fix_uniform(&random) * (v + 1)), swap = number[v];
        number[v] = number[other], number[other] = swap;
    }
    for (int32_t v = 0; v < n; v++) memcpy(vertex + 3 * number[v], block->rest_m + 3 * v, 24);
    for (int32_t i = 0; i < 4 * block->tet_count; i++) tet[i] = number[block->tet[i]];
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = n, def.vertex_m = vertex, def.tet_count = block->tet_count, def.tet = tet;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    tm_mesh_destroy(block);
    free(number), free(tet), free(vertex);
    return mesh;
}

static void bits_are_the_same_for_any_numbering(void **state) {
    (void)state;
    tm_mesh *mesh = shuffled();
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.45, &material, &error), &error);
    tm_tissue *tissue = fix_tissue(mesh, &material, NULL, TM_DOUBLE, false);
    uint64_t one = 0;
    const int first = test_watches_threads() ? 3 : 0;
    for (int t = first; t < 4; t++) {
        tm_world_def def = tm_world_def_default();
        def.tissue = tissue, def.threads = THREADS[t], def.damped = false;
        tm_world *world = NULL;
        fix_ok(tm_world_create(&def, &world, &error), &error);
        assert_int_equal(tm_world_partitions(world), THREADS[t]);
        fix_random random = {9};
        tm_state *s = tm_world_state(world);
        for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) s->u_m[i] = s->u_prev_m[i] = 1e-5 * fix_signed(&random);
        assert_int_equal(tm_world_step(world, 20), TM_OK);
        if (t == first) one = tm_world_hash(world);
        assert_true(tm_world_hash(world) == one);
        tm_world_destroy(world);
    }
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* Counts the edges that a partition computes, including those to other partitions, and two for each vertex. */
static int64_t cost_of_part(const tm_tissue *tissue, const tm_force_partition *part) {
    int64_t cost = 2 * (int64_t)(part->end - part->begin);
    for (int32_t p = 0; p < tissue->pair_count; p++) {
        const int32_t k = tissue->pair[2 * p], l = tissue->pair[2 * p + 1];
        cost += (k >= part->begin && k < part->end) || (l >= part->begin && l < part->end);
    }
    return cost;
}

/* In order a tenth of the edges connects two partitions, at random half of them; the later partitions once computed
 * all of those. */
static void partitions_have_equal_cost(void **state) {
    (void)state;
    fix_random random = {5};
    tm_mesh *mesh[2] = {fix_block((int[3]){14, 14, 14}, (double[3]){0.1, 0.1, 0.1}, 0.2, &random), shuffled()};
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.45, &material, &error), &error);
    for (int m = 0; m < 2; m++) {
        tm_tissue *tissue = fix_tissue(mesh[m], &material, NULL, TM_DOUBLE, false);
        for (int t = 1; t < 4; t++) {
            tm_world_def def = tm_world_def_default();
            def.tissue = tissue, def.threads = THREADS[t], def.damped = false;
            tm_world *world = NULL;
            fix_ok(tm_world_create(&def, &world, &error), &error);
            int64_t least = INT64_MAX, most = 0;
            for (int32_t p = 0; p < THREADS[t]; p++) {
                const int64_t cost = cost_of_part(tissue, &world->partition[p].force);
                least = cost < least ? cost : least, most = cost > most ? cost : most;
            }
            assert_true(world->partition[THREADS[t] - 1].force.end == mesh[m]->vertex_count);
            assert_true((double)most < 1.1 * (double)least);
            tm_world_destroy(world);
        }
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh[m]);
    }
}

/* --- tissue with rotation, averaged dilatation, viscosity --- */

enum { TURNED = 1, VOLUME = 2, RELAXES = 4, KINDS = 8 };

/* Noise on a rotation, cut on the way, snapshots of the histories: the same bits for any number of threads and any
 * form. */
static uint64_t effects_story(const tm_mesh *mesh, tm_force_form form, int kind, bool account, int32_t threads) {
    tm_material material;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.45, &material, &error), &error);
    tm_tissue_def of = tm_tissue_def_default();
    of.mesh = mesh, of.material_count = 1, of.material = &material, of.form = form, of.cuttable = true;
    of.rotation = kind & TURNED ? TM_ROTATION_THRESHOLD : 0, of.strain_smoothing = kind & VOLUME,
    of.smoothed_shear_share = 0;
    tm_tissue *tissue = NULL;
    fix_ok(tm_tissue_create(&of, &tissue, &error), &error);
    tm_world_def def = tm_world_def_default();
    def.tissue = tissue, def.threads = threads;
    tm_world *world = NULL;
    fix_ok(tm_world_create(&def, &world, &error), &error);
    assert_int_equal(tm_world_partitions(world), threads);
    tm_rotation *rotation = NULL;
    if (kind & TURNED) fix_ok(tm_stage_rotation(world, &rotation, &error), &error);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){.time_s = 0.01, .shear = 0.3, .bulk = 0.1};
    viscosity.term[1] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.2};
    if (kind & RELAXES) fix_ok(tm_stage_viscosity(world, &viscosity, &error), &error);
    if (account) fix_ok(tm_stage_energy(world, &error), &error);
    fix_random random = {9};
    tm_state *s = tm_world_state(world);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        const double *x = mesh->rest_m + i / 3 * 3, turn[3] = {-0.3 * x[0] - 0.7 * x[1], 0.7 * x[0] - 0.3 * x[1], 0};
        const double share = fmax(0, x[0] / 0.1 - 0.4); /* not all of it rotates */
        s->u_m[i] = s->u_prev_m[i] = share * (turn[i % 3] + 2e-4 * fix_signed(&random));
    }
    assert_int_equal(tm_world_step(world, 8), TM_OK);
    assert_true(tm_cut_remove(tissue, (int32_t[]){50, 51, 52, 4000}, 4, NULL, 0) >= 4);
    assert_int_equal(tm_world_step(world, 8), TM_OK);
    const int64_t bytes = tm_snapshot_bytes(world);
    void *kept = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(world, kept, bytes, &error), &error);
    if (kind == TURNED) {
        const tm_rotation_report report = tm_rotation_last(rotation);
        assert_true(report.active > 100 && report.active < report.batches);
        assert_int_equal(rotation->divided, threads > 1);
    }
    tm_energy energy = {0};
    if (account) fix_ok(tm_world_energy(world, &energy, &error), &error);
    uint64_t hash = tm_hash(kept, (size_t)bytes, tm_world_hash(world));
    hash = tm_hash(s->force_N, 24 * (size_t)mesh->vertex_count, tm_hash(&energy, sizeof energy, hash));
    free(kept);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    return hash;
}

static void rotation_dilatation_and_viscosity_have_the_same_bits(void **state) {
    (void)state;
    tm_mesh *mesh = shuffled();
    for (int kind = 1; kind < KINDS; kind++) {
        if (kind == VOLUME) continue;       /* its tensors are those of any tissue */
        const bool account = kind & VOLUME; /* of tensors and of the complete law */
        if (test_watches_threads()) {       /* with each of the three */
            if (kind == TURNED || kind == RELAXES || kind == KINDS - 1)
                effects_story(mesh, TM_FORCE_BEST, kind, account, THREADS[2]);
            continue;
        }
        const uint64_t one = effects_story(mesh, TM_FORCE_BEST, kind, account, 1);
        /* In the short form one number of threads each, in turn. */
        for (int t = test_is_long() ? 1 : 1 + kind % 3; t < (test_is_long() ? 4 : 2 + kind % 3); t++)
            assert_true(effects_story(mesh, TM_FORCE_BEST, kind, account, THREADS[t]) == one);
        /* Where the complete law is computed without tensors all forms have the same bits. */
        if (!(kind & TURNED) || kind == TURNED || test_is_sanitized()) continue;
        const uint64_t best = effects_story(mesh, TM_FORCE_BEST, kind, false, 1);
        assert_true(effects_story(mesh, TM_FORCE_PLAIN, kind, false, 2) == best);
    }
    tm_mesh_destroy(mesh);
}

/* --- loops over vertices --- */

/* Gravity and integration written out, one vertex at a time: the step has the same bits for any number of vertices
 * at a time. */
static void vertex_loops_have_the_bits_of_single_vertices(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = 5, def.cells[1] = 6, def.cells[2] = 4;
    scene s = scene_create(&def);
    tm_error error;
    fix_ok(tm_world_remove_stage(s.world, "contact", &error), &error);
    fix_ok(tm_world_remove_stage(s.world, "support", &error), &error);
    const double g[3] = {1.1, -2.3, -9.81}, dt = tm_world_step_s(s.world);
    fix_ok(tm_stage_gravity(s.world, g, &error), &error);
    const int32_t n = 3 * s.mesh->vertex_count;
    double *f = malloc(sizeof(double) * (size_t)n), *expected = malloc(sizeof(double) * (size_t)n);
    fix_random random = {4};
    for (int32_t i = 0; i < n; i++) tm_world_state(s.world)->u_m[i] = 1e-4 * fix_signed(&random);
    for (int k = 0; k < 5; k++) {
        const tm_state *now = tm_world_state(s.world);
        tm_tissue_force(s.tissue, now->u_m, f);
        for (int32_t i = 0; i < n; i++) {
            const double mass = tm_tissue_mass_kg(s.tissue)[i / 3], drag = tm_tissue_damping_kg_s(s.tissue)[i / 3];
            const double inertia = mass / (dt * dt), half = drag / (2 * dt), weight = inertia + half;
            f[i] += mass * g[i % 3];
            expected[i] = now->u_m[i] + (inertia - half) / weight * (now->u_m[i] - now->u_prev_m[i]) +
                          tm_world_mobility_s2_kg(s.world)[i / 3] * f[i];
        }
        assert_int_equal(tm_world_step(s.world, 1), TM_OK);
        assert_memory_equal(tm_world_state(s.world)->u_m, expected, sizeof(double) * (size_t)n);
    }
    free(f), free(expected);
    scene_destroy(&s);
}

/* --- other guarantees of a step --- */

static void one_bad_vertex_fails_the_complete_step(void **state) {
    (void)state;
    scene s = create(TM_FORCE_BEST, TM_DOUBLE, 3, NULL);
    uint64_t hash[FRAMES];
    play(&s, hash);
    tm_state *state_of = tm_world_state(s.world);
    for (int32_t v = s.mesh->vertex_count / 2; v < s.mesh->vertex_count; v += s.mesh->vertex_count / 2 - 1) {
        const double was = state_of->u_prev_m[3 * v];
        state_of->u_prev_m[3 * v] = -1e7;
        const uint64_t before = tm_world_hash(s.world);
        assert_int_equal(tm_world_step(s.world, 8), TM_ERR_UNSTABLE);
        assert_true(tm_world_hash(s.world) == before);
        state_of = tm_world_state(s.world);
        state_of->u_prev_m[3 * v] = was;
        assert_int_equal(tm_world_step(s.world, 8), TM_OK);
    }
    scene_destroy(&s);
}

static void small_tissue_uses_one_thread(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 6, def.cells[2] = 4, def.threads = 8;
    scene s = scene_create(&def);
    assert_int_equal(tm_world_partitions(s.world), 1);
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = s.tissue;
    tm_world *world = NULL;
    tm_error error;
    for (int32_t wrong = 0; wrong <= TM_MAX_THREADS + 1; wrong += TM_MAX_THREADS + 1) {
        world_def.threads = wrong;
        assert_int_equal(tm_world_create(&world_def, &world, &error), TM_ERR_ARGUMENT);
        assert_non_null(strstr(error.message, "threads; give 1 to 64"));
    }
    scene_destroy(&s);
}

/* Threads exist as long as their world; a call of one step does not wake them. */
static void threads_start_and_end_with_their_world(void **state) {
    (void)state;
    const int64_t before = tm_memory_in_use();
    for (int i = 0; i < 3; i++) {
        scene s = create(TM_FORCE_BEST, TM_DOUBLE, 8, NULL);
        for (int k = 0; k < 20; k++) assert_int_equal(tm_world_step(s.world, k % 6), TM_OK);
        scene_destroy(&s);
    }
    assert_int_equal(tm_memory_in_use(), before);
}

/* Runs partitions in order, with a pause before the last: the other threads are late. */
static void late_parts(void *user, void (*work)(void *context, int32_t part), void *context, int32_t parts) {
    for (int32_t p = 0; p < parts; p++) {
        if (p == parts - 1) nanosleep(&(const struct timespec){0, 1000000}, NULL);
        work(context, p);
    }
    ++*(int *)user;
}

/* The wait is attributed to the stage in which the other threads still work: mostly "force", not the last stage of
 * the pass. */
static void waiting_is_attributed_to_the_stage_at_work(void **state) {
    (void)state;
    fix_random random = {9};
    tm_mesh *mesh = fix_block((int[]){10, 10, 8}, (double[]){0.1, 0.1, 0.08}, 0.1, &random);
    tm_material material;
    tm_tissue *tissue;
    tm_world *world;
    tm_error error;
    fix_ok(tm_material_young(5e3, 0.4, &material, &error), &error);
    material.damping_1_s = 40;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    int passes = 0;
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = tissue, world_def.threads = 2;
    world_def.parallel_for = late_parts, world_def.parallel_for_user = &passes;
    fix_ok(tm_world_create(&world_def, &world, &error), &error);
    assert_int_equal(tm_world_partitions(world), 2);
    const int32_t dof[3] = {0, 1, 2};
    const double zero[3] = {0};
    tm_support_def support = tm_support_def_default();
    support.count = 3, support.dof = dof, support.value_m = zero;
    fix_ok(tm_stage_support(world, &support, &error), &error);
    tm_world_set_timing(world, true);
    assert_int_equal(tm_world_step(world, 50), TM_OK);
    tm_stage_report report[TM_MAX_STAGES];
    const int32_t count = tm_world_stages(world, report);
    double force_s = 0, support_s = 0, sum_s = 0;
    for (int32_t i = 0; i < count; i++) {
        sum_s += report[i].seconds;
        if (!strcmp(report[i].name, "force")) force_s = report[i].seconds;
        if (!strcmp(report[i].name, "support")) support_s = report[i].seconds;
    }
    print_message("  force %.1f ms, support %.1f ms of %.1f\n", 1e3 * force_s, 1e3 * support_s, 1e3 * sum_s);
    assert_true(passes >= 50 && sum_s > 0.045); /* no time is lost */
    assert_true(support_s < 0.3 * sum_s && force_s > 0.5 * sum_s);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(bits_are_the_same_for_any_number_of_threads),
                                       cmocka_unit_test(caller_threads_give_the_same_bits),
                                       cmocka_unit_test(contact_detection_overlaps_the_force_pass),
                                       cmocka_unit_test(patches_have_the_same_bits),
                                       cmocka_unit_test(bits_are_the_same_for_any_numbering),
                                       cmocka_unit_test(partitions_have_equal_cost),
                                       cmocka_unit_test(rotation_dilatation_and_viscosity_have_the_same_bits),
                                       cmocka_unit_test(vertex_loops_have_the_bits_of_single_vertices),
                                       cmocka_unit_test(one_bad_vertex_fails_the_complete_step),
                                       cmocka_unit_test(small_tissue_uses_one_thread),
                                       cmocka_unit_test(threads_start_and_end_with_their_world),
                                       cmocka_unit_test(waiting_is_attributed_to_the_stage_at_work)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
