/* Arguments of the solve library: data out of range is rejected with its index, a contract error reaches the handler,
 * and a hybrid model that could not join a world is unchanged. */
#include "kit.h"

typedef struct block {
    tm_mesh *mesh;
    tm_tissue *tissue;
    uint8_t *fixed, *dynamic;
} block;

static block make_block(void) {
    fix_random random = {1};
    const tm_material material = kit_material(5e3, 0.4);
    block b = {.mesh = fix_block((const int[3]){4, 3, 3}, (const double[3]){0.04, 0.03, 0.03}, 0.1, &random)};
    b.tissue = fix_tissue(b.mesh, &material, NULL, TM_DOUBLE, false);
    b.fixed = kit_clamp(b.mesh, 1e-9);
    b.dynamic = calloc((size_t)b.mesh->tet_count, 1);
    for (int32_t t = 0; t < b.mesh->tet_count; t++) b.dynamic[t] = b.mesh->rest_m[3 * b.mesh->tet[4 * t]] > 0.019;
    return b;
}

static void free_block(block *b) {
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->fixed), free(b->dynamic);
}

static void refused(tm_status status, int64_t entity, const tm_error *error) {
    assert_int_equal(status, TM_ERR_ARGUMENT);
    assert_int_equal(error->entity, entity);
    assert_non_null(strstr(error->message, "; "));
}

static void invalid_problems_are_rejected(void **state) {
    (void)state;
    block b = make_block();
    tm_error error;
    const int32_t n = 3 * b.mesh->vertex_count;
    double *value = calloc((size_t)n, 8), *load = calloc((size_t)n, 8), *u = calloc((size_t)n, 8);
    int32_t held = 0;
    while (!b.fixed[held]) held++;
    tm_solve_def def = kit_problem(b.tissue, b.fixed);
    def.fixed_value_m = value, def.load_N = load;
    value[held] = NAN;
    refused(tm_solve_static(&def, u, NULL, NULL, &error), held / 3, &error);
    value[held] = 0, load[n - 1] = INFINITY;
    refused(tm_solve_static(&def, u, NULL, NULL, &error), n / 3 - 1, &error);
    load[n - 1] = 0, def.solver = (tm_solver)5;
    refused(tm_solve_static(&def, u, NULL, NULL, &error), -1, &error);
    def.solver = TM_SOLVER_CG, def.cg_tolerance = NAN;
    refused(tm_solve_static(&def, u, NULL, NULL, &error), -1, &error);
    def = kit_problem(b.tissue, b.fixed);
    def.threads = -1;
    refused(tm_solve_static(&def, u, NULL, NULL, &error), -1, &error);
    def.threads = 1;
    tm_precomputed_def stored = tm_precomputed_def_default();
    tm_precomputed *model = NULL;
    stored.problem = def, stored.precision = (tm_precision)7;
    refused(tm_precomputed_create(&stored, &model, NULL, &error), -1, &error);
    stored.precision = TM_DOUBLE, stored.max_contact_vertices = -1;
    refused(tm_precomputed_create(&stored, &model, NULL, &error), -1, &error);
    tm_hybrid_def mixed = tm_hybrid_def_default();
    tm_hybrid *hybrid = NULL;
    mixed.problem = def, mixed.dynamic = b.dynamic, mixed.max_contact_vertices = -1;
    refused(tm_hybrid_create(&mixed, &hybrid, NULL, &error), -1, &error);
    assert_true(!model && !hybrid);
    free(value), free(load), free(u);
    free_block(&b);
}

static void invalid_imposed_displacements_are_rejected(void **state) {
    (void)state;
    block b = make_block();
    tm_error error;
    tm_precomputed_def def = tm_precomputed_def_default();
    def.problem = kit_problem(b.tissue, b.fixed);
    tm_precomputed *model = NULL;
    fix_ok(tm_precomputed_create(&def, &model, NULL, &error), &error);
    const int32_t *surface, vertices = tm_precomputed_surface(model, &surface);
    const int32_t vertex[2] = {surface[vertices - 1], surface[vertices - 2]};
    double u[6] = {0, 0, 1e-3, 0, 0, 1e-3}, before[3], after[3];
    fix_ok(tm_precomputed_impose(model, 2, vertex, u, 0, &error), &error);
    assert_true(tm_precomputed_update(model, NULL) >= 0);
    tm_precomputed_imposed_force(model, 0, before);
    u[4] = NAN;
    refused(tm_precomputed_impose(model, 2, vertex, u, 0, &error), vertex[1], &error);
    u[4] = 0;
    refused(tm_precomputed_impose(model, -1, vertex, u, 0, &error), -1, &error);
    refused(tm_precomputed_impose(model, 2, vertex, u, NAN, &error), -1, &error);
    /* Rejected input has changed nothing. */
    assert_true(tm_precomputed_update(model, NULL) >= 0);
    tm_precomputed_imposed_force(model, 0, after);
    assert_true(isfinite(after[2]) && fabs(after[2] - before[2]) <= 1e-9 * fabs(before[2]) && before[2] != 0);
    tm_precomputed_destroy(model);
    free_block(&b);
}

static int broken;
static void on_broken(const char *function, const char *sentence, void *user) {
    (void)function, (void)sentence, (void)user;
    broken++;
}

static void contract_errors_reach_the_handler(void **state) {
    (void)state;
    block b = make_block();
    tm_error error;
    tm_instrument_def tool = {.radius_m = 0.0025, .contact_length_m = 0.1, .trocar_m = {0.02, 0.015, 0.2}};
    tool.pose.tip_m[2] = 0.1;
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    tm_precomputed_def def = tm_precomputed_def_default();
    def.problem = kit_problem(b.tissue, b.fixed), def.contact = &contact;
    tm_precomputed *model = NULL;
    fix_ok(tm_precomputed_create(&def, &model, NULL, &error), &error);
    tm_set_contract_handler(on_broken, NULL);
    double f[3];
    static tm_patch patch;
    tm_tool_pose pose = tool.pose;
    pose.tip_m[0] = NAN;
    int expected = 0;
    tm_precomputed_force(model, 1, f), expected++;
    tm_precomputed_reaction(model, -1), expected++;
    tm_precomputed_pose(model, 2), expected++;
    tm_precomputed_grasped(model, 1, NULL, NULL), expected++;
    assert_int_equal(tm_precomputed_update(model, &pose), -1), expected++;
    tm_precomputed_set_pose(model, 0, &pose), expected++;
    tm_precomputed_imposed_force(model, 0, f), expected++;
    assert_false(tm_precomputed_patch(model, 0, f, 0.1, 99, 32, &patch)), expected++;
    tm_solve_def problem = {.tissue = b.tissue, .fixed = b.fixed};
    assert_int_equal(tm_solve_static(&problem, NULL, NULL, NULL, &error), TM_ERR_ARGUMENT), expected++;
    assert_int_equal(tm_stage_hybrid(NULL, NULL, NULL, &error), TM_ERR_ARGUMENT), expected++;
    assert_int_equal(broken, expected);
    tm_set_contract_handler(NULL, NULL);
    /* Flags: a converged force has none. */
    assert_true(tm_precomputed_update(model, &tool.pose) >= 0);
    assert_int_equal(tm_precomputed_force(model, 0, f), 0);
    tm_precomputed_destroy(model);
    free_block(&b);
}

static tm_world *hybrid_world(const block *b, tm_hybrid *hybrid, tm_tissue **tissue, const tm_contact_def *contact_def,
                              tm_contact **contact) {
    const tm_material material = kit_material(5e3, 0.4);
    tm_error error;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = b->mesh, def.material_count = 1, def.material = &material, def.form = TM_FORCE_PLAIN;
    tm_hybrid_tissue(hybrid, &def);
    fix_ok(tm_tissue_create(&def, tissue, &error), &error);
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = *tissue, world_def.dt_s = 0.9 * tm_hybrid_critical_step(hybrid, NULL);
    tm_world *world = NULL;
    fix_ok(tm_world_create(&world_def, &world, &error), &error);
    fix_ok(tm_stage_contact(world, contact_def, contact, &error), &error);
    return world;
}

static void nothing(void *self, tm_world *world) { (void)self, (void)world; }

static void press(tm_world *world, tm_contact *contact) {
    const tm_tool_pose to = {.tip_m = {0.035, 0.015, 0.028}, .active = true};
    for (int i = 0; i < 4; i++) {
        tm_contact_begin_frame(contact, 50, 50);
        tm_contact_set_target(contact, 0, &to, 50);
        assert_int_equal(tm_world_step(world, 50), TM_OK);
    }
}

/* A hybrid model that fails late leaves neither its world nor itself half set; the contact stage cannot be removed
 * from under it. */
static void late_failure_leaves_nothing_half_set(void **state) {
    (void)state;
    block b = make_block();
    tm_error error;
    tm_instrument_def tool = {.radius_m = 0.0025,
                              .contact_length_m = 0.1,
                              .trocar_m = {0.035, 0.015, 0.2},
                              .pose = {.tip_m = {0.035, 0.015, 0.04}, .active = true}};
    tm_contact_def contact_def = tm_contact_def_default();
    contact_def.instrument_count = 1, contact_def.instrument = &tool;
    tm_hybrid_def def = tm_hybrid_def_default();
    def.problem = kit_problem(b.tissue, b.fixed), def.dynamic = b.dynamic, def.contact = &contact_def;
    uint64_t hash[2];
    double force[2];
    for (int failing = 0; failing < 2; failing++) {
        tm_hybrid *hybrid = NULL;
        tm_tissue *tissue = NULL;
        tm_contact *contact = NULL;
        fix_ok(tm_hybrid_create(&def, &hybrid, NULL, &error), &error);
        tm_world *world = hybrid_world(&b, hybrid, &tissue, &contact_def, &contact);
        if (failing) {
            const tm_stage dummy = {.size = sizeof dummy, .name = "hybrid", .phase = TM_PHASE_END, .run = nothing};
            fix_ok(tm_world_add_stage(world, &dummy, 0, &error), &error);
            assert_int_equal(tm_stage_hybrid(world, hybrid, contact, &error), TM_ERR_ARGUMENT);
            assert_int_equal(tm_world_step(world, 1), TM_OK); /* contact's own solver */
            fix_ok(tm_world_remove_stage(world, "hybrid", &error), &error);
            tm_world_destroy(world); /* and the hybrid may join another world */
            tm_tissue_destroy(tissue);
            world = hybrid_world(&b, hybrid, &tissue, &contact_def, &contact);
        }
        fix_ok(tm_stage_hybrid(world, hybrid, contact, &error), &error);
        assert_int_equal(tm_world_remove_stage(world, "contact", &error), TM_ERR_ARGUMENT);
        assert_non_null(strstr(error.message, "hybrid"));
        press(world, contact);
        hash[failing] = tm_world_hash(world);
        force[failing] = tm_contact_reaction(contact, 0).force_N[2];
        fix_ok(tm_world_remove_stage(world, "hybrid", &error), &error);
        assert_int_equal(tm_world_step(world, 1), TM_OK);
        fix_ok(tm_stage_hybrid(world, hybrid, contact, &error), &error); /* it may join again */
        assert_int_equal(tm_world_step(world, 1), TM_OK);
        tm_world_destroy(world);
        tm_hybrid_destroy(hybrid);
        tm_tissue_destroy(tissue);
    }
    assert_true(hash[0] == hash[1] && force[0] == force[1] && force[0] > 0);
    free_block(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(invalid_problems_are_rejected), cmocka_unit_test(invalid_imposed_displacements_are_rejected),
        cmocka_unit_test(contract_errors_reach_the_handler), cmocka_unit_test(late_failure_leaves_nothing_half_set)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
