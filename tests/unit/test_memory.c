/* The allocator hook: exact accounts, every n-th allocation failing, none within a step. And the small things of
 * base.h. */
#include "../fixture.h"

/* An allocator that counts, fails on the n-th call, or fails every call while armed. */
static struct {
    int64_t calls, fail_at, live, live_bytes;
    bool armed;
} hook;

static void *hook_alloc(size_t bytes, void *user) {
    assert_ptr_equal(user, &hook);
    hook.calls++;
    if (hook.armed || hook.calls == hook.fail_at) return NULL;
    hook.live++, hook.live_bytes += (int64_t)bytes;
    void *memory = aligned_alloc(64, bytes);
    memset(memory, 0xA5, bytes);
    return memory;
}
static void hook_free(void *memory, size_t bytes, void *user) {
    assert_ptr_equal(user, &hook);
    hook.live--, hook.live_bytes -= (int64_t)bytes;
    memset(memory, 0x5A, bytes);
    free(memory);
}

static void install(int64_t fail_at) {
    memset(&hook, 0, sizeof hook);
    hook.fail_at = fail_at;
    tm_set_allocator(&(tm_allocator){hook_alloc, hook_free, &hook});
}

typedef struct scene {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
} scene;

static void destroy(scene *s) {
    tm_world_destroy(s->world);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
}

static const double vertex[15] = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0.01, 0.01, 0.01};
static const int32_t tet[8] = {0, 1, 2, 3, 1, 2, 3, 4};

/* Everything the core can allocate for; stops at the first failure. */
static tm_status build(scene *s, tm_error *error) {
    static const double fibre[6] = {1, 0, 0, 0, 1, 0}, zero[9] = {0}, force[15] = {[12] = 1e-3};
    static const int32_t dof[9] = {0, 1, 2, 3, 4, 5, 6, 7, 8};
    static const uint8_t alive[2] = {1, 1};
    *s = (scene){0};
    tm_mesh_def mesh = tm_mesh_def_default();
    mesh.vertex_count = 5, mesh.vertex_m = vertex, mesh.tet_count = 2, mesh.tet = tet;
    tm_status status = tm_mesh_create(&mesh, &s->mesh, error);
    if (status) return status;
    tm_material material;
    fix_ok(tm_material_paper(1e4, 3e3, 1.2e4, 9e3, &material, error), error);
    material.damping_1_s = 5;
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = s->mesh, tissue.material_count = 1, tissue.material = &material, tissue.fibre = fibre,
    tissue.cuttable = true, tissue.alive = alive;
    status = tm_tissue_create(&tissue, &s->tissue, error);
    if (status) return status;
    tm_world_def world = tm_world_def_default();
    world.tissue = s->tissue;
    status = tm_world_create(&world, &s->world, error);
    tm_support_def support = tm_support_def_default();
    support.count = 9, support.dof = dof, support.value_m = zero;
    if (!status) status = tm_stage_support(s->world, &support, error);
    if (!status) status = tm_stage_gravity(s->world, (const double[3]){0, 0, -9.81}, error);
    if (!status) status = tm_stage_load(s->world, force, error);
    tm_settle_def settle = tm_settle_def_default();
    if (!status) status = tm_world_settle(s->world, &settle, NULL, error);
    double step_s;
    if (!status) status = tm_critical_step_sharp(s->tissue, NULL, 1e-6, 1000, &step_s, error);
    return status;
}

static void every_allocation_fails_once(void **state) {
    (void)state;
    scene s;
    tm_error error;
    install(0);
    fix_ok(build(&s, &error), &error);
    const int64_t calls = hook.calls;
    destroy(&s);
    assert_true(calls > 40);
    for (int64_t n = 1; n <= calls; n++) {
        install(n);
        error.status = TM_OK;
        const tm_status status = build(&s, &error);
        if (status != TM_ERR_MEMORY)
            fail_msg("allocation %lld of %lld: %s", (long long)n, (long long)calls, tm_status_name(status));
        assert_int_equal(error.status, TM_ERR_MEMORY);
        assert_non_null(strstr(error.message, "; "));
        destroy(&s);
        assert_int_equal(hook.live, 0);
        assert_int_equal(hook.live_bytes, 0);
        assert_int_equal(tm_memory_in_use(), 0);
    }
    tm_set_allocator(NULL);
}

static void accounts_are_exact(void **state) {
    (void)state;
    scene s;
    tm_error error;
    install(0);
    fix_ok(build(&s, &error), &error);
    assert_int_equal(tm_memory_in_use(), hook.live_bytes);
    assert_true(tm_memory_high_water() >= hook.live_bytes);
    /* A stage costs what it says, and gives it all back. */
    const int64_t with = tm_memory_in_use();
    tm_stage_report report[TM_MAX_STAGES];
    int64_t bytes = 0;
    for (int32_t i = tm_world_stages(s.world, report) - 1; i >= 0; i--)
        if (!strcmp(report[i].name, "gravity")) bytes = report[i].bytes;
    fix_ok(tm_world_remove_stage(s.world, "gravity", &error), &error);
    assert_true(bytes > 0);
    assert_int_equal(tm_memory_in_use(), with - bytes);
    destroy(&s);
    assert_int_equal(tm_memory_in_use(), 0);
    void *own = tm_allocate(100);
    assert_true(tm_memory_in_use() >= 100 && (uintptr_t)own % 64 == 0);
    tm_release(own, 100);
    tm_release(NULL, 100);
    assert_int_equal(tm_memory_in_use(), 0);
    tm_set_allocator(NULL);
}

static void no_allocation_in_a_step(void **state) {
    (void)state;
    scene s;
    tm_error error;
    install(0);
    fix_ok(build(&s, &error), &error);
    const int64_t calls = hook.calls;
    hook.armed = true;
    assert_int_equal(tm_world_step(s.world, 200), TM_OK);
    tm_world_set_timing(s.world, true);
    assert_int_equal(tm_world_step(s.world, 5), TM_OK);
    fix_ok(tm_world_set_step(s.world, tm_world_step_s(s.world) / 2, &error), &error);
    assert_int_equal(hook.calls, calls);
    tm_stage_report report[TM_MAX_STAGES];
    double seconds = 0;
    const int32_t stages = tm_world_stages(s.world, report);
    for (int32_t i = 0; i < stages; i++) {
        assert_int_equal(report[i].runs, 205);
        if (i) assert_true(report[i].phase >= report[i - 1].phase);
        seconds += report[i].seconds;
    }
    assert_int_equal(stages, 5);
    assert_true(seconds > 0);
    hook.armed = false;
    destroy(&s);
    tm_set_allocator(NULL);
}

static void names_and_hash(void **state) {
    (void)state;
    assert_string_equal(tm_version(), "0.1.0");
    assert_string_equal(tm_status_name(TM_ERR_MESH), "TM_ERR_MESH");
    assert_string_equal(tm_status_name((tm_status)77), "TM_ERR_UNKNOWN");
    for (int i = 0; i >= -11; i--) assert_true(strcmp(tm_status_name((tm_status)i), "TM_ERR_UNKNOWN"));
    /* FNV-1a's published values. */
    assert_true(tm_hash("", 0, TM_HASH_SEED) == 0xcbf29ce484222325ULL);
    assert_true(tm_hash("a", 1, TM_HASH_SEED) == 0xaf63dc4c8601ec8cULL);
    assert_true(tm_hash("bar", 3, tm_hash("foo", 3, TM_HASH_SEED)) == 0x85944171f73967e8ULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_allocation_fails_once),
                                       cmocka_unit_test(accounts_are_exact), cmocka_unit_test(no_allocation_in_a_step),
                                       cmocka_unit_test(names_and_hash)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
