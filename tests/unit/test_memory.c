/* The allocator hook: exact accounts, failure of every n-th allocation, no allocation within a step. Also the
 * helpers of base.h. */
#include "../allocator.h"
#include "tensormass/energy.h"

#include <unistd.h>

typedef struct scene {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_contact *contact;
} scene;

static void destroy(scene *s) {
    tm_world_destroy(s->world);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
}

static const double vertex[15] = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0.01, 0.01, 0.01};
static const int32_t tet[8] = {0, 1, 2, 3, 1, 2, 3, 4};

/* Calls everything in the core that allocates; stops at the first failure. */
static tm_status build_as(scene *s, bool volume, bool cuttable, tm_error *error) {
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
    tissue.cuttable = cuttable, tissue.alive = alive, tissue.strain_smoothing = volume;
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
    if (!status) status = tm_critical_step_estimate(s->tissue, NULL, 1e-6, 1000, &step_s, error);
    return status;
}

static tm_status build(scene *s, tm_error *error) { return build_as(s, false, true, error); }

static void fail_each(bool volume, bool cuttable) {
    scene s;
    tm_error error;
    hook_install(0);
    fix_ok(build_as(&s, volume, cuttable, &error), &error);
    const int64_t calls = hook.calls;
    destroy(&s);
    assert_true(calls > 40);
    for (int64_t n = 1; n <= calls; n++) {
        hook_install(n);
        error.status = TM_OK;
        const tm_status status = build_as(&s, volume, cuttable, &error);
        if (status != TM_ERR_MEMORY)
            fail_msg("allocation %lld of %lld: %s", (long long)n, (long long)calls, tm_status_name(status));
        assert_int_equal(error.status, TM_ERR_MEMORY);
        assert_non_null(strstr(error.message, "; "));
        destroy(&s);
        hook_check_empty();
    }
    tm_set_allocator(NULL);
}

static void every_allocation_fails_once(void **state) {
    (void)state;
    fail_each(false, true);
    fail_each(true, true);
    fail_each(true, false);
}

/* --- memory without alignment --- */

static int told;
static void on_broken(const char *function, const char *sentence, void *user) {
    (void)user;
    assert_string_equal(function, "tm_set_allocator");
    assert_non_null(strstr(sentence, "aligned to 64 bytes"));
    told++;
}

static int64_t askew_live;
static void *askew_alloc(size_t bytes, void *user) {
    (void)user;
    char *memory = aligned_alloc(64, bytes + 64);
    askew_live++;
    return memory + 16; /* aligned as by malloc */
}
static void askew_free(void *memory, size_t bytes, void *user) {
    (void)bytes;
    (void)user;
    askew_live--;
    free((char *)memory - 16);
}

/* Vector loads would fault on it: the error is reported, the memory freed, and no object made. */
static void unaligned_memory_is_reported(void **state) {
    (void)state;
    scene s;
    tm_error error = {0};
    tm_set_allocator(&(tm_allocator){askew_alloc, askew_free, NULL});
    tm_set_contract_handler(on_broken, NULL);
    assert_int_equal(build(&s, &error), TM_ERR_MEMORY);
    assert_int_equal(told, 1);
    assert_null(tm_allocate(100));
    assert_int_equal(told, 2);
    assert_int_equal(askew_live, 0);
    assert_int_equal(tm_memory_in_use(), 0);
    tm_set_contract_handler(NULL, NULL);
    tm_set_allocator(NULL);
}

/* --- stages of instruments, each added to an existing world --- */

enum { CONTACT, GRASP, PATCH, PATCH_WITH_SOURCE, CUT, ENERGY, KINDS };

static const tm_compliance *no_pieces(void *self, int32_t owner, const tm_compliance_request *request) {
    (void)self, (void)owner, (void)request;
    return NULL;
}

static tm_status add_contact(scene *s, tm_error *error) {
    const tm_instrument_def tool[2] = {{.mode = TM_TOOL_GRASPER,
                                        .trocar_m = {0.002, 0.002, 0.1},
                                        .radius_m = 0.002,
                                        .contact_length_m = 0.05,
                                        .pose = {{0.002, 0.002, 0.013}, .active = true}},
                                       {.mode = TM_TOOL_CAUTERY,
                                        .trocar_m = {0.008, 0.008, 0.1},
                                        .radius_m = 0.002,
                                        .contact_length_m = 0.05,
                                        .pose = {.tip_m = {0.008, 0.008, 0.02}}}};
    tm_contact_def def = tm_contact_def_default();
    def.instrument_count = 2, def.instrument = tool;
    return tm_stage_contact(s->world, &def, &s->contact, error);
}

static tm_status add(scene *s, int kind, tm_error *error) {
    const tm_compliance_source source = {.exchange = no_pieces};
    tm_grasp *grasp = NULL;
    tm_patch_builder *maker = NULL;
    tm_grasp_def grasp_def = tm_grasp_def_default();
    tm_patch_def patch_def = tm_patch_def_default();
    tm_cut_def cut_def = tm_cut_def_default();
    if (kind == CONTACT) return add_contact(s, error);
    if (kind == GRASP) return tm_stage_grasp(s->world, s->contact, &grasp_def, &grasp, error);
    if (kind == CUT) return tm_stage_cut(s->world, s->contact, &cut_def, error);
    if (kind == ENERGY) return tm_stage_energy(s->world, error);
    if (kind == PATCH_WITH_SOURCE) patch_def.source = &source;
    return tm_stage_patch(s->world, s->contact, &patch_def, &maker, error);
}

/* Ten steps with the tool on its way down. */
static uint64_t press(scene *s) {
    const tm_tool_pose to = {{0.002, 0.002, 0.008}, .active = true};
    if (s->contact) {
        tm_contact_begin_frame(s->contact, 10, 10);
        tm_contact_set_target(s->contact, 0, &to, 10);
    }
    assert_int_equal(tm_world_step(s->world, 10), TM_OK);
    return tm_world_hash(s->world);
}

/* A stage that finds no memory is absent and holds nothing, and the world continues unchanged; a second request
 * succeeds. */
static void stage_without_memory_is_absent(void **state) {
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        uint64_t without = 0, with = 0;
        int64_t calls = 0;
        for (int64_t n = -1; n <= calls; n++) { /* -1: never added; 0: added at once */
            scene s;
            tm_error error;
            hook_install(0);
            fix_ok(build(&s, &error), &error);
            if (kind != CONTACT) fix_ok(add_contact(&s, &error), &error);
            tm_stage_report report[TM_MAX_STAGES];
            const int32_t stages = tm_world_stages(s.world, report);
            const int64_t before = hook.calls, bytes = tm_memory_in_use();
            if (n > 0) {
                hook.fail_at = before + n;
                error.status = TM_OK;
                assert_int_equal(add(&s, kind, &error), TM_ERR_MEMORY);
                assert_int_equal(error.status, TM_ERR_MEMORY);
                assert_non_null(strstr(error.message, "; "));
                assert_int_equal(tm_world_stages(s.world, report), stages);
                assert_int_equal(tm_memory_in_use(), bytes);
                assert_int_equal(hook.live_bytes, bytes);
                assert_true(kind != CONTACT || !s.contact);
            }
            if (n == 0) {
                fix_ok(add(&s, kind, &error), &error);
                calls = hook.calls - before;
                assert_true(calls > 0 && tm_world_stages(s.world, report) > stages);
                with = press(&s);
            } else {
                const uint64_t hash = press(&s);
                if (n < 0) without = hash;
                assert_true(hash == without);
                if (n > 0) fix_ok(add(&s, kind, &error), &error);
                if (n > 0) press(&s);
            }
            destroy(&s);
            hook_check_empty();
        }
        assert_true(with != 0 && calls > 0);
    }
    tm_set_allocator(NULL);
}

static void nothing(void *self, tm_world *world) { (void)self, (void)world; }

/* The same if the world has no place left for the stage, or not for all of its substages. */
static void stage_without_capacity_is_absent(void **state) {
    (void)state;
    static char name[TM_MAX_STAGES][8];
    for (int kind = 0; kind < KINDS; kind++) {
        uint64_t without = 0;
        int refused = 0;
        for (int32_t room = -1; room < 6; room++) { /* -1: never requested */
            scene s;
            tm_error error;
            hook_install(0);
            fix_ok(build(&s, &error), &error);
            if (kind != CONTACT) fix_ok(add_contact(&s, &error), &error);
            tm_stage_report report[TM_MAX_STAGES];
            for (int32_t i = tm_world_stages(s.world, report); i < TM_MAX_STAGES - (room < 0 ? 0 : room); i++) {
                snprintf(name[i], sizeof name[i], "d%d", (int)i);
                const tm_stage dummy = {.size = sizeof dummy, .name = name[i], .phase = TM_PHASE_END, .run = nothing};
                fix_ok(tm_world_add_stage(s.world, &dummy, 0, &error), &error);
            }
            const int32_t stages = tm_world_stages(s.world, report);
            const int64_t bytes = tm_memory_in_use();
            const tm_status status = room < 0 ? TM_ERR_LIMIT : add(&s, kind, &error);
            if (status == TM_ERR_LIMIT) {
                assert_int_equal(tm_world_stages(s.world, report), stages);
                assert_int_equal(tm_memory_in_use(), bytes);
                assert_true(kind != CONTACT || !s.contact);
                const uint64_t hash = press(&s);
                if (room < 0) without = hash;
                assert_true(hash == without);
                refused += room >= 0;
            } else {
                fix_ok(status, &error);
                assert_true(room > 0);
            }
            destroy(&s);
            hook_check_empty();
        }
        assert_true(refused > 0 && refused < 6);
    }
    tm_set_allocator(NULL);
}

static void memory_of_a_stage_is_exact(void **state) {
    (void)state;
    scene s;
    tm_error error;
    hook_install(0);
    fix_ok(build(&s, &error), &error);
    assert_int_equal(tm_memory_in_use(), hook.live_bytes);
    assert_true(tm_memory_high_water() >= hook.live_bytes);
    /* A stage takes exactly the memory that it states, and returns all of it. */
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
    hook_install(0);
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

/* Returns whether the mapping that contains `memory` requests large pages. */
static bool is_on_large_pages(const void *memory) {
    FILE *maps = fopen("/proc/self/smaps", "r");
    assert_non_null(maps);
    char line[512];
    bool inside = false, asked = false;
    for (unsigned long begin, end; fgets(line, sizeof line, maps);) {
        if (sscanf(line, "%lx-%lx ", &begin, &end) == 2)
            inside = (uintptr_t)memory >= begin && (uintptr_t)memory < end;
        else if (inside && !strncmp(line, "VmFlags:", 8))
            asked = strstr(line, " hg") != NULL;
    }
    fclose(maps);
    return asked;
}

/* Arrays that a pass reads at once use large pages, if the system has them; small arrays do not. */
static void large_arrays_use_large_pages(void **state) {
    (void)state;
    enum { LARGE = 12 << 20, SMALL = 1 << 16 };
    if (access("/sys/kernel/mm/transparent_hugepage/enabled", R_OK) || access("/proc/self/smaps", R_OK)) skip();
    char *large = tm_allocate(LARGE), *small = tm_allocate(SMALL);
    assert_non_null(large);
    assert_non_null(small);
    assert_int_equal((uintptr_t)large % (2 << 20), 0);
    assert_true(is_on_large_pages(large));
    assert_true(is_on_large_pages(large + LARGE - 1));
    assert_false(is_on_large_pages(small));
    tm_release(large, LARGE);
    tm_release(small, SMALL);
}

static void names_of_statuses_and_hash_values(void **state) {
    (void)state;
    assert_string_equal(tm_version(), "0.2.0");
    assert_string_equal(tm_status_name(TM_ERR_MESH), "TM_ERR_MESH");
    assert_string_equal(tm_status_name((tm_status)77), "TM_ERR_UNKNOWN");
    for (int i = 0; i >= -11; i--) assert_true(strcmp(tm_status_name((tm_status)i), "TM_ERR_UNKNOWN"));
    /* FNV-1a's published values. */
    assert_true(tm_hash("", 0, TM_HASH_SEED) == 0xcbf29ce484222325ULL);
    assert_true(tm_hash("a", 1, TM_HASH_SEED) == 0xaf63dc4c8601ec8cULL);
    assert_true(tm_hash("bar", 3, tm_hash("foo", 3, TM_HASH_SEED)) == 0x85944171f73967e8ULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_allocation_fails_once),    cmocka_unit_test(unaligned_memory_is_reported),
        cmocka_unit_test(stage_without_memory_is_absent), cmocka_unit_test(stage_without_capacity_is_absent),
        cmocka_unit_test(memory_of_a_stage_is_exact),     cmocka_unit_test(no_allocation_in_a_step),
        cmocka_unit_test(large_arrays_use_large_pages),   cmocka_unit_test(names_of_statuses_and_hash_values)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
