/* Two worlds are independent. Each has contact, graspers, cautery, patches and the energy account; in two threads at
 * once they are bit-identical to one after the other. make sanitize runs it under ThreadSanitizer, which reports any
 * shared memory. */
#include "../fixture.h"
#include "../long.h"
#include "contact_scene.h"

#include <pthread.h>

enum { FRAMES = 30, CAUTERY = 0, GRASPER = 1 };
static const double FRAME_S = 0.005;

typedef struct half {
    scene s;
    tm_grasp *grasp;
    tm_patch_builder *maker;
    tm_patch patch;
    pthread_barrier_t *start; /* null: alone */
    double shift_m;
    int32_t cut, held, patches; /* tetrahedra, maximum vertices, computed patches */
    bool stepped;
    uint64_t hash;
} half;

static half *half_create(double shift_m, double young_Pa) {
    static const tm_tool_mode mode[2] = {TM_TOOL_CAUTERY, TM_TOOL_GRASPER};
    half *h = calloc(1, sizeof *h);
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 6, def.cells[2] = 4, def.tools = 2, def.young_Pa = young_Pa;
    h->s = scene_create_full(&def, true, mode);
    h->shift_m = shift_m;
    tm_error error;
    tm_cut_def cut = tm_cut_def_default();
    cut.rate_1_s = 400;
    fix_ok(tm_stage_cut(h->s.world, h->s.contact, &cut, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    grasp.reach_m = 0.004;
    fix_ok(tm_stage_grasp(h->s.world, h->s.contact, &grasp, &h->grasp, &error), &error);
    tm_patch_def patch = tm_patch_def_default();
    fix_ok(tm_stage_patch(h->s.world, h->s.contact, &patch, &h->maker, &error), &error);
    fix_ok(tm_stage_gravity(h->s.world, (const double[3]){0, 0, -9.81}, &error), &error);
    fix_ok(tm_stage_energy(h->s.world, &error), &error);
    h->hash = TM_HASH_SEED;
    return h;
}

static void half_destroy(half *h) {
    scene_destroy(&h->s);
    free(h);
}

/* The cautery cuts its way in; the grasper grasps, pulls and releases. */
static void frame(half *h, int i) {
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(h->s.world));
    const tm_tool_pose burn = scene_pose(0.012 + 0.0004 * i, 0.005 + h->shift_m, 0.046 - 0.0005 * i);
    tm_tool_pose jaw = scene_pose(-0.012, -0.003 + h->shift_m, 0.044 + 0.0002 * (i > 12 ? i - 12 : 0));
    jaw.grip = i >= 6 && i < 24 ? 1 : 0;
    tm_contact_begin_frame(h->s.contact, substeps, substeps / 2);
    tm_contact_set_target(h->s.contact, CAUTERY, &burn, substeps);
    tm_contact_set_target(h->s.contact, GRASPER, &jaw, substeps);
    h->stepped = h->stepped && tm_world_step(h->s.world, substeps) == TM_OK;
    for (int t = 0; t < 2; t++) {
        const tm_tool_reaction r = tm_contact_reaction(h->s.contact, t);
        h->hash = tm_hash(r.force_N, sizeof r.force_N, tm_hash(&r.flags, sizeof r.flags, h->hash));
        if (!tm_patch_compute(h->maker, t, &h->patch)) continue;
        h->patches++;
        h->hash = tm_hash(h->patch.vertex_m, sizeof h->patch.vertex_m, h->hash);
    }
    int32_t tet[64];
    int8_t by[64];
    h->cut += tm_cut_fetch_removed(h->s.world, tet, by, 64);
    const int32_t held = tm_grasp_vertices(h->grasp, GRASPER, NULL, NULL);
    if (held > h->held) h->held = held;
}

static void *play(void *of) {
    half *h = of;
    if (h->start) pthread_barrier_wait(h->start);
    h->stepped = true;
    for (int i = 0; i < FRAMES; i++) frame(h, i);
    tm_energy energy;
    h->stepped = h->stepped && tm_world_energy(h->s.world, &energy, NULL) == TM_OK;
    h->hash = tm_hash(&energy.kinetic_J, sizeof energy.kinetic_J, h->hash);
    h->hash ^= tm_world_hash(h->s.world);
    return NULL;
}

static void two_worlds_in_two_threads_are_independent(void **state) {
    (void)state;
    half *h[4]; /* 0 and 1 concurrently, then the same two one after the other */
    const int count = test_watches_threads() ? 2 : 4;
    for (int i = 0; i < count; i++) h[i] = half_create(i % 2 ? 0.003 : 0, i % 2 ? 5000 : 8000);
    pthread_barrier_t start;
    pthread_barrier_init(&start, NULL, 2);
    h[0]->start = h[1]->start = &start;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, play, h[0]), 0);
    play(h[1]);
    pthread_join(thread, NULL);
    pthread_barrier_destroy(&start);
    for (int i = 2; i < count; i++) play(h[i]);
    for (int i = 0; i < count; i++) {
        assert_true(h[i]->stepped);
        assert_true(h[i]->cut > 0 && h[i]->held > 0 && h[i]->patches > 0); /* every tested event occurred */
    }
    for (int i = 2; i < count; i++) assert_true(h[i]->hash == h[i - 2]->hash);
    assert_true(h[0]->hash != h[1]->hash);
    print_message("  %d and %d tetrahedra cut, %d and %d vertices held, %d and %d patches\n", h[0]->cut, h[1]->cut,
                  h[0]->held, h[1]->held, h[0]->patches, h[1]->patches);
    for (int i = 0; i < count; i++) half_destroy(h[i]);
}

/* A sequence of other worlds is created and freed meanwhile: that shares no memory either. */
static void *come_and_go(void *of) {
    uint64_t *hash = of;
    const double vertex[15] = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0.01, 0.01, 0.01};
    const int32_t tet[8] = {0, 1, 2, 3, 1, 2, 3, 4};
    for (int i = 0; i < 50; i++) {
        tm_mesh *mesh = NULL;
        tm_tissue *tissue = NULL;
        tm_world *world = NULL;
        tm_material material;
        tm_mesh_def mesh_def = tm_mesh_def_default();
        mesh_def.vertex_count = 5, mesh_def.vertex_m = vertex, mesh_def.tet_count = 2, mesh_def.tet = tet;
        tm_tissue_def def = tm_tissue_def_default();
        tm_world_def world_def = tm_world_def_default();
        bool good =
            tm_mesh_create(&mesh_def, &mesh, NULL) == TM_OK && tm_material_young(5e3, 0.4, &material, NULL) == TM_OK;
        def.mesh = mesh, def.material_count = 1, def.material = &material, def.cuttable = true;
        good = good && tm_tissue_create(&def, &tissue, NULL) == TM_OK;
        world_def.tissue = tissue;
        good = good && tm_world_create(&world_def, &world, NULL) == TM_OK;
        good = good && tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, NULL) == TM_OK;
        good = good && tm_world_step(world, 3) == TM_OK;
        if (good) *hash = tm_hash(tm_world_state(world)->u_m, 15 * sizeof(double), *hash);
        tm_world_destroy(world);
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh);
    }
    return NULL;
}

static void worlds_created_and_freed_meanwhile_share_nothing(void **state) {
    (void)state;
    uint64_t hash[3] = {TM_HASH_SEED, TM_HASH_SEED, TM_HASH_SEED};
    const int64_t before = tm_memory_in_use();
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, come_and_go, hash), 0);
    come_and_go(hash + 1);
    pthread_join(thread, NULL);
    come_and_go(hash + 2);
    assert_true(hash[0] == hash[2] && hash[1] == hash[2] && hash[2] != TM_HASH_SEED);
    assert_int_equal(tm_memory_in_use(), before);
}

/* --- stack: musl gives a thread 128 kB, macOS 512 kB --- */

enum { STACK = 1 << 20, UNTOUCHED = 0x5a };

/* Returns the bytes of stack that work(of) uses, in a thread whose stack is filled with a pattern first. */
static int64_t stack_used(void *(*work)(void *), void *of) {
    uint8_t *stack = aligned_alloc(4096, STACK);
    memset(stack, UNTOUCHED, STACK);
    pthread_attr_t attributes;
    pthread_t thread;
    pthread_attr_init(&attributes);
    assert_int_equal(pthread_attr_setstack(&attributes, stack, STACK), 0);
    assert_int_equal(pthread_create(&thread, &attributes, work, of), 0);
    pthread_join(thread, NULL);
    pthread_attr_destroy(&attributes);
    int64_t untouched = 0;
    while (untouched < STACK && stack[untouched] == UNTOUCHED) untouched++;
    free(stack);
    return STACK - untouched;
}

typedef struct finding {
    half *h;
    tm_contact_search *work;
    int32_t rows;
} finding;

static void *find(void *of) {
    finding *f = of;
    const scene *s = &f->h->s;
    const tm_surface_view surface = tm_tissue_surface(s->tissue);
    const tm_capsule tool = {.tip_m = {0.01, 0.005, 0.0425}, .tail_m = {-0.03, 0.005, 0.0425}, .radius_m = 0.0025};
    tm_contact_row row[64];
    f->rows = tm_contact_find(f->work, s->mesh->rest_m, tm_world_state(s->world)->u_m, surface.triangle, surface.face,
                              NULL, surface.count, &tool, 5e-4, row, 64, NULL);
    return NULL;
}

static void *nothing(void *of) { return of; }

static void contact_fits_a_small_stack(void **state) {
    (void)state;
    half *h = half_create(0, 8000);
    finding f = {.h = h};
    tm_error error;
    fix_ok(tm_contact_search_create(&f.work, &error), &error);
    const int64_t none = stack_used(nothing, NULL), found = stack_used(find, &f) - none,
                  played = stack_used(play, h) - none;
    print_message("  stack: %lld bytes to find rows, %lld to step contact, grasp, cut and patch\n", (long long)found,
                  (long long)played);
    assert_true(f.rows > 3 && h->stepped && h->cut > 0 && h->held > 0 && h->patches > 0);
    if (!test_is_sanitized()) assert_true(found < 64 * 1024 && played < 100 * 1024); /* frames are larger there */
    tm_contact_search_destroy(f.work);
    half_destroy(h);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(two_worlds_in_two_threads_are_independent),
                                       cmocka_unit_test(worlds_created_and_freed_meanwhile_share_nothing),
                                       cmocka_unit_test(contact_fits_a_small_stack)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
