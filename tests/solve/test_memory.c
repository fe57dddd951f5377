/* Memory of the solve library: everything is freed with the sizes of its allocation. If any allocation fails, the
 * object is not made, nothing stays allocated, and its world continues. */
#include "../allocator.h"
#include "kit.h"
#include "tensormass/cut.h"

typedef struct block {
    tm_mesh *mesh;
    tm_tissue *tissue;
    uint8_t *fixed, *dynamic;
    tm_contact_def contact;
    tm_grasp_def grasp;
} block;

static const tm_instrument_def tool = {.mode = TM_TOOL_GRASPER,
                                       .radius_m = 0.0025,
                                       .contact_length_m = 0.1,
                                       .trocar_m = {0.035, 0.015, 0.2},
                                       .pose = {.tip_m = {0.035, 0.015, 0.04}, .active = true}};

static block make_block(void) {
    fix_random random = {1};
    const double along[3] = {1, 2, 2};
    tm_material material;
    tm_error error;
    fix_ok(tm_material_five(3000, 2000, 4000, 3000, 900, &material, &error), &error);
    block b = {.mesh = fix_block((const int[3]){4, 2, 2}, (const double[3]){0.04, 0.03, 0.03}, 0.1, &random)};
    b.tissue = fix_tissue(b.mesh, &material, along, TM_DOUBLE, true);
    b.fixed = kit_clamp(b.mesh, 1e-9);
    b.dynamic = calloc((size_t)b.mesh->tet_count, 1);
    for (int32_t t = 0; t < b.mesh->tet_count; t++) b.dynamic[t] = b.mesh->rest_m[3 * b.mesh->tet[4 * t]] > 0.019;
    b.contact = tm_contact_def_default();
    b.contact.instrument_count = 1, b.contact.instrument = &tool;
    b.grasp = tm_grasp_def_default();
    b.grasp.max_vertices = 16;
    return b;
}

static void free_block(block *b) {
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->fixed), free(b->dynamic);
}

static tm_solve_def problem_of(const block *b) {
    tm_solve_def def = kit_problem(b->tissue, b->fixed);
    def.threads = 1;
    return def;
}

/* --- each function makes an object, uses it and frees it; returns the status of making it --- */

typedef tm_status (*making)(const block *b, tm_error *error);

static tm_status solve_static(const block *b, tm_error *error) {
    const tm_solve_def def = problem_of(b);
    return tm_solve_static(&def, NULL, NULL, NULL, error);
}

static tm_status solve_cg(const block *b, tm_error *error) {
    tm_solve_def def = problem_of(b);
    def.solver = TM_SOLVER_CG;
    return tm_solve_static(&def, NULL, NULL, NULL, error);
}

static void use_precomputed(const block *b, tm_precomputed *model) {
    static tm_patch patch;
    const double still[3] = {0}, up[3] = {0, 0, 1e-3};
    const int32_t *surface, vertex = (tm_precomputed_surface(model, &surface), surface[0]);
    tm_tool_pose pose = {.tip_m = {0.035, 0.015, 0.028}, .active = true};
    for (int i = 0; i < 4; i++) {
        pose.grip = i == 2;
        assert_true(tm_precomputed_update(model, &pose) >= 0);
        assert_true(isfinite(tm_precomputed_reaction(model, 0).force_N[2]));
    }
    tm_precomputed_patch(model, 0, still, 0.08, 24, 32, &patch);
    tm_error error;
    fix_ok(tm_precomputed_impose(model, 1, &vertex, up, 0, &error), &error);
    tm_precomputed_update(model, &pose);
    assert_true(fix_largest(tm_precomputed_displacement(model), 3 * b->mesh->vertex_count) > 0);
}

static tm_status make_precomputed(const block *b, tm_error *error) {
    tm_precomputed_def def = tm_precomputed_def_default();
    tm_precomputed *model = NULL;
    def.problem = problem_of(b), def.contact = &b->contact, def.grasp = &b->grasp, def.max_contact_vertices = 128;
    const tm_status status = tm_precomputed_create(&def, &model, NULL, error);
    assert_true((status == TM_OK) == (model != NULL));
    const int64_t calls = hook.calls;
    if (model) use_precomputed(b, model);
    assert_int_equal(hook.calls, calls); /* updates allocate nothing more */
    tm_precomputed_destroy(model);
    return status;
}

typedef struct mixed {
    tm_hybrid *hybrid;
    tm_tissue *tissue;
    tm_world *world;
    tm_contact *contact;
} mixed;

static tm_status make_hybrid(const block *b, mixed *m, tm_error *error) {
    tm_hybrid_def def = tm_hybrid_def_default();
    def.problem = problem_of(b), def.dynamic = b->dynamic, def.contact = &b->contact;
    def.max_contact_vertices = 128;
    return tm_hybrid_create(&def, &m->hybrid, NULL, error);
}

static void open_world(const block *b, mixed *m) {
    const tm_material material = kit_material(2e3, 0.4);
    tm_error error;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b->mesh, def.material_count = 1, def.material = &material, def.form = TM_FORCE_PLAIN;
    tm_hybrid_tissue(m->hybrid, &def);
    fix_ok(tm_tissue_create(&def, &m->tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = m->tissue, world.dt_s = 0.9 * tm_hybrid_critical_step(m->hybrid, NULL);
    fix_ok(tm_world_create(&world, &m->world, &error), &error);
    fix_ok(tm_stage_contact(m->world, &b->contact, &m->contact, &error), &error);
}

static void close_world(mixed *m) {
    tm_world_destroy(m->world);
    tm_hybrid_destroy(m->hybrid);
    tm_tissue_destroy(m->tissue);
}

static uint64_t press(mixed *m) {
    const tm_tool_pose to = {.tip_m = {0.035, 0.015, 0.028}, .active = true};
    tm_contact_begin_frame(m->contact, 100, 50);
    tm_contact_set_target(m->contact, 0, &to, 100);
    assert_int_equal(tm_world_step(m->world, 100), TM_OK);
    return tm_world_hash(m->world);
}

static tm_status make_hybrid_alone(const block *b, tm_error *error) {
    mixed m = {0};
    const tm_status status = make_hybrid(b, &m, error);
    assert_true((status == TM_OK) == (m.hybrid != NULL));
    tm_hybrid_destroy(m.hybrid);
    return status;
}

static tm_status make_factored_alone(const block *b, tm_error *error) {
    tm_compliance_factor *factored = NULL;
    tm_compliance_factor_def def = tm_compliance_factor_def_default();
    def.tissue = b->tissue, def.fixed = b->fixed;
    const tm_status status = tm_compliance_factor_create(&def, &factored, error);
    assert_true((status == TM_OK) == (factored != NULL));
    tm_compliance_factor_destroy(factored);
    return status;
}

static void any_failed_allocation_leaves_no_object(void **state) {
    (void)state;
    const making make[] = {solve_static, solve_cg, make_precomputed, make_hybrid_alone, make_factored_alone};
    const char *name[] = {"static", "static, conjugate gradients", "precomputed", "hybrid", "factored"};
    for (size_t i = 0; i < sizeof make / sizeof *make; i++) {
        hook_install(0);
        block b = make_block();
        tm_error error;
        const int64_t live = hook.live, bytes = tm_memory_in_use(), before = hook.calls;
        fix_ok(make[i](&b, &error), &error);
        const int64_t calls = hook.calls - before;
        assert_int_equal(tm_memory_in_use(), bytes);
        for (int64_t n = 1; n <= calls; n++) {
            hook.fail_at = hook.calls + n;
            error = (tm_error){0};
            const tm_status status = make[i](&b, &error);
            if (status != TM_ERR_MEMORY || error.status != TM_ERR_MEMORY || !strstr(error.message, "; "))
                fail_msg("%s, allocation %d of %d: %s, \"%s\"", name[i], (int)n, (int)calls, tm_status_name(status),
                         error.message);
            if (hook.live != live || hook.live_bytes != bytes || tm_memory_in_use() != bytes)
                fail_msg("%s, allocation %d of %d: %d blocks are left", name[i], (int)n, (int)calls,
                         (int)(hook.live - live));
        }
        print_message("  %s: %d allocations\n", name[i], (int)calls);
        assert_true(calls > 5);
        hook.fail_at = 0;
        fix_ok(make[i](&b, &error), &error);
        free_block(&b);
        hook_check_empty();
    }
    tm_set_allocator(NULL);
}

/* If the stage "hybrid" finds no memory, the world keeps contact's own solver. Added again it succeeds, and runs
 * like one added at once. */
static void hybrid_stage_without_memory_leaves_the_world_unchanged(void **state) {
    (void)state;
    uint64_t without = 0, with = 0;
    int64_t calls = 0;
    for (int64_t n = -1; n <= calls; n++) { /* -1: never added; 0: added at once */
        hook_install(0);
        block b = make_block();
        tm_error error;
        mixed m = {0}, twin = {0};
        fix_ok(make_hybrid(&b, &m, &error), &error);
        open_world(&b, &m);
        const int64_t before = hook.calls, bytes = tm_memory_in_use();
        if (n > 0) {
            hook.fail_at = before + n;
            error = (tm_error){0};
            assert_int_equal(tm_stage_hybrid(m.world, m.hybrid, m.contact, &error), TM_ERR_MEMORY);
            assert_true(error.status == TM_ERR_MEMORY && strstr(error.message, "; "));
            assert_int_equal(tm_memory_in_use(), bytes);
            assert_int_equal(hook.live_bytes, bytes);
        }
        if (n != 0) {
            const uint64_t hash = press(&m);
            if (n < 0) without = hash;
            assert_true(hash == without);
        }
        if (n >= 0) {
            if (n > 0) { /* the same hybrid, in a world that has not moved */
                twin.hybrid = m.hybrid;
                open_world(&b, &twin);
            }
            mixed *in = n > 0 ? &twin : &m;
            const int64_t first = hook.calls;
            fix_ok(tm_stage_hybrid(in->world, in->hybrid, in->contact, &error), &error);
            calls = hook.calls - first;
            const int64_t taken = hook.calls;
            const uint64_t hash = press(in);
            tm_hybrid_recover(in->hybrid, in->world);
            assert_true(tm_hybrid_reaction(in->hybrid, 0).force_N[2] > 0);
            assert_int_equal(hook.calls, taken);
            if (n == 0) with = hash;
            assert_true(hash == with && hash != without);
            tm_world_destroy(twin.world);
            tm_tissue_destroy(twin.tissue);
        }
        close_world(&m);
        free_block(&b);
        hook_check_empty();
    }
    assert_true(calls > 5);
    tm_set_allocator(NULL);
}

/* Compliance is computed at the first request: a failure gives no result, leaks nothing and changes nothing else. */
static void compliance_without_memory_gives_no_result(void **state) {
    (void)state;
    int64_t calls = 0;
    for (int64_t n = 0; n <= calls; n++) {
        hook_install(0);
        block b = make_block();
        tm_error error;
        tm_compliance_factor *factored = NULL;
        tm_compliance_factor_def def = tm_compliance_factor_def_default();
        def.tissue = b.tissue, def.fixed = b.fixed;
        fix_ok(tm_compliance_factor_create(&def, &factored, &error), &error);
        const tm_compliance_source source = tm_compliance_factor_source(factored);
        const tm_surface_view surface = tm_tissue_surface(b.tissue);
        const int32_t tet = b.mesh->tet_count - 1, last = surface.triangle[0];
        const int64_t before = hook.calls;
        int served = 0;
        if (n) hook.fail_at = before + n;
        for (int i = 0; i < 6; i++) {
            if (i == 3) assert_true(tm_cut_remove(b.tissue, &tet, 1, NULL, 0) > 0);
            const tm_compliance *c =
                source.exchange(source.self, 0, &(tm_compliance_request){.count = 1, .needed = 1, .vertex = &last});
            served += c != NULL;
            if (c) assert_true(c->count == 1 && c->C_m_N[0] >= 0 && isfinite(c->C_m_N[0]));
        }
        if (n == 0) calls = hook.calls - before;
        assert_true(n > 0 || served > 3);
        tm_compliance_factor_destroy(factored);
        free_block(&b);
        hook_check_empty();
    }
    assert_true(calls > 5);
    tm_set_allocator(NULL);
}

/* Responses in a file: nothing stays allocated, whether they were written or read. */
static void responses_in_a_file_leak_nothing(void **state) {
    (void)state;
    char path[] = "/tmp/tm-memory-XXXXXX";
    assert_non_null(mkdtemp(path));
    char file[64];
    snprintf(file, sizeof file, "%s/responses", path);
    hook_install(0);
    block b = make_block();
    const int64_t bytes = tm_memory_in_use();
    for (int i = 0; i < 2; i++) {
        tm_precomputed_def def = tm_precomputed_def_default();
        tm_precomputed *model = NULL;
        tm_solve_report report;
        tm_error error;
        def.problem = problem_of(&b), def.contact = &b.contact, def.grasp = &b.grasp, def.file = file;
        fix_ok(tm_precomputed_create(&def, &model, &report, &error), &error);
        assert_true(report.from_file == (i == 1));
        assert_true(tm_memory_in_use() > bytes);
        use_precomputed(&b, model);
        tm_precomputed_destroy(model);
        assert_int_equal(tm_memory_in_use(), bytes);
    }
    free_block(&b);
    hook_check_empty();
    tm_set_allocator(NULL);
    remove(file), remove(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(any_failed_allocation_leaves_no_object),
                                       cmocka_unit_test(hybrid_stage_without_memory_leaves_the_world_unchanged),
                                       cmocka_unit_test(compliance_without_memory_gives_no_result),
                                       cmocka_unit_test(responses_in_a_file_leak_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
