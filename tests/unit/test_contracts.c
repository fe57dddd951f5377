/* Contracts are checked in the shipped build: each contract error reaches the handler with the function's name and
 * changes nothing; data out of range returns a status with its index. */
#include "../fixture.h"
#include "../physics/contact_scene.h"

static int broken;
static char last_function[64], last_sentence[160];

static void on_broken(const char *function, const char *sentence, void *user) {
    assert_ptr_equal(user, &broken);
    broken++;
    snprintf(last_function, sizeof last_function, "%s", function);
    snprintf(last_sentence, sizeof last_sentence, "%s", sentence);
}

/* The call must reach the handler once, named `function`. */
#define BREAKS(function, ...)                                                                                          \
    do {                                                                                                               \
        const int heard = broken;                                                                                      \
        (void)(__VA_ARGS__);                                                                                           \
        if (broken != heard + 1) fail_msg("line %d: the handler heard %d times of it", __LINE__, broken - heard);      \
        assert_string_equal(last_function, function);                                                                  \
        assert_true(strlen(last_sentence) > 5);                                                                        \
    } while (0)

/* A world with tools, jaws and patches, which no broken contract changes. */
typedef struct whole {
    scene s;
    tm_grasp *hold;
    tm_patch_builder *maker;
    uint64_t before;
} whole;

static int setup(void **state) {
    static whole w;
    tm_error error;
    const tm_grasp_def grasp = tm_grasp_def_default();
    const tm_patch_def patch = tm_patch_def_default();
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 4, def.cells[2] = 3;
    w = (whole){.s = scene_create_full(&def, true, NULL)};
    fix_ok(tm_stage_grasp(w.s.world, w.s.contact, &grasp, &w.hold, &error), &error);
    fix_ok(tm_stage_patch(w.s.world, w.s.contact, &patch, &w.maker, &error), &error);
    w.before = tm_world_hash(w.s.world);
    tm_set_contract_handler(on_broken, &broken);
    broken = 0;
    *state = &w;
    return 0;
}

static int teardown(void **state) {
    whole *w = *state;
    assert_true(w->before == tm_world_hash(w->s.world));
    assert_int_equal(tm_world_step(w->s.world, 5), TM_OK);
    tm_set_contract_handler(NULL, NULL);
    scene_destroy(&w->s);
    return 0;
}

/* Functions of contact detection and jaws, for models outside the library. */
static void broken_contract_of_jaws_is_told(void **state) {
    const scene *s = &((whole *)*state)->s;
    const double zero[3] = {0};
    double out[3];
    tm_jaw jaw = {0};
    const tm_tool_pose pose = scene_pose(0, 0, 0.05);
    const tm_instrument_def tool = {.radius_m = 0.002, .contact_length_m = 0.05, .trocar_m = {0, 0, 0.25}};
    const tm_grasp_def grasp = tm_grasp_def_default();
    const tm_surface_view surface = tm_tissue_surface(s->tissue);
    const double *rest = s->mesh->rest_m, *u = tm_world_state(s->world)->u_m;
    BREAKS("tm_jaw_begin", tm_jaw_begin(&jaw, &tool, NULL), 0);
    BREAKS("tm_jaw_rotate", tm_jaw_rotate(&jaw, NULL, &pose), 0);
    BREAKS("tm_jaw_to_tool", tm_jaw_to_tool(NULL, &pose, zero, out), 0);
    BREAKS("tm_jaw_to_world", tm_jaw_to_world(&jaw, &pose, zero, NULL), 0);
    BREAKS("tm_jaw_capture", tm_jaw_capture(&jaw, &grasp, &tool, &pose, rest, NULL, &surface, NULL, NULL));
    BREAKS("tm_jaw_capture", tm_jaw_capture(&jaw, &grasp, &tool, &pose, rest, u, &surface, NULL, NULL));
    BREAKS("tm_tool_capsule", tm_tool_capsule(&tool, NULL, 0));
    BREAKS("tm_tip_force", tm_tip_force(zero, zero, zero, NULL, out), 0);
}

static void broken_contract_of_the_search_is_told(void **state) {
    const scene *s = &((whole *)*state)->s;
    const tm_tool_pose pose = scene_pose(0, 0, 0.05);
    const tm_instrument_def tool = {.radius_m = 0.002, .contact_length_m = 0.05, .trocar_m = {0, 0, 0.25}};
    const tm_surface_view surface = tm_tissue_surface(s->tissue);
    const double *rest = s->mesh->rest_m, *u = tm_world_state(s->world)->u_m;
    tm_error error;
    tm_contact_search *search = NULL;
    tm_contact_row row[4];
    bool overflowed = false;
    const int32_t *list;
    tm_capsule capsule = tm_tool_capsule(&tool, &pose, 0);
    BREAKS("tm_contact_search_create", tm_contact_search_create(NULL, &error));
    fix_ok(tm_contact_search_create(&search, &error), &error);
    BREAKS("tm_contact_search_gather", tm_contact_search_gather(search, rest, u, NULL, &capsule, 0.01));
    BREAKS("tm_contact_search_gather", tm_contact_search_gather(NULL, rest, u, &surface, &capsule, 0.01));
    BREAKS("tm_contact_search_vertices", tm_contact_search_vertices(search, NULL));
    BREAKS("tm_contact_search_faces", tm_contact_search_faces(search, &list, NULL));
    BREAKS("tm_contact_search_restore", tm_contact_search_restore(search, rest, &surface, NULL, 1, 0.01));
    BREAKS("tm_contact_search_rows",
           tm_contact_search_rows(search, rest, NULL, &capsule, 0, NULL, 0, row, 4, &overflowed));
    BREAKS("tm_contact_search_rows",
           tm_contact_search_rows(search, rest, u, &capsule, 0, NULL, 2, row, 4, &overflowed));
    capsule.radius_m = 0;
    BREAKS("tm_contact_find", tm_contact_find(NULL, rest, u, surface.triangle, surface.face, NULL, surface.count,
                                              &capsule, 0, row, 4, &overflowed));
    BREAKS("tm_contact_find", tm_contact_find(search, rest, u, surface.triangle, surface.face, NULL, surface.count,
                                              &capsule, 0, row, 4, &overflowed));
    tm_contact_search_destroy(search);
}

static void broken_contract_of_the_patch_solver_is_told(void **state) {
    (void)state;
    const double zero[3] = {0};
    double out[3];
    tm_error error;
    tm_patch_solver *solver = NULL;
    static tm_patch patch;
    double K[9];
    fix_ok(tm_patch_solver_create(&solver, &error), &error);
    patch.radius_m = 0.002, patch.vertex_count = TM_PATCH_VERTICES + 1;
    BREAKS("tm_patch_force", tm_patch_force(solver, &patch, zero, out, NULL), 0);
    patch.vertex_count = 3, patch.triangle_count = 1, patch.triangle[2] = 3;
    BREAKS("tm_patch_force", tm_patch_force(solver, &patch, zero, out, NULL), 0);
    BREAKS("tm_patch_stiffness", tm_patch_stiffness(solver, &patch, zero, K), 0);
    BREAKS("tm_patch_stiffness", tm_patch_stiffness(solver, NULL, zero, K), 0);
    patch.triangle[2] = 2;
    BREAKS("tm_patch_force", tm_patch_force(solver, &patch, NULL, out, NULL), 0);
    BREAKS("tm_patch_force", tm_patch_force(NULL, &patch, zero, out, NULL), 0);
    tm_patch_solver_destroy(solver);
}

static void broken_contract_of_tissue_is_told(void **state) {
    const whole *w = *state;
    const int32_t foreign[2] = {0, w->s.mesh->tet_count};
    const int32_t tets = tm_tissue_alive_count(w->s.tissue);
    tm_error error;
    double K[9], step_s;
    BREAKS("tm_cut_remove", tm_cut_remove(w->s.tissue, foreign, 2, NULL, 0));
    assert_int_equal(tm_tissue_alive_count(w->s.tissue), tets); /* nor the first index, which is one of its own */
    BREAKS("tm_cut_remove", tm_cut_remove(w->s.tissue, NULL, 1, NULL, 0));
    BREAKS("tm_cut_remove", tm_cut_remove(NULL, foreign, 1, NULL, 0));
    BREAKS("tm_tissue_vertex_tensor", tm_tissue_vertex_tensor(w->s.tissue, w->s.mesh->vertex_count, K), 0);
    BREAKS("tm_tissue_edge_tensor", tm_tissue_edge_tensor(w->s.tissue, -1, K), 0);
    BREAKS("tm_tissue_tet_material", tm_tissue_tet_material(w->s.tissue, tets));
    BREAKS("tm_critical_step_element", tm_critical_step_element(w->s.tissue, tets));
    BREAKS("tm_critical_step_estimate", tm_critical_step_estimate(NULL, NULL, 1e-3, 10, &step_s, &error));
}

static void broken_contract_of_a_mesh_is_told(void **state) {
    const whole *w = *state;
    BREAKS("tm_mesh_tet_quality", tm_mesh_tet_quality(w->s.mesh, -1));
    BREAKS("tm_mesh_original_vertex", tm_mesh_original_vertex(w->s.mesh, w->s.mesh->vertex_count));
    BREAKS("tm_mesh_to_original", tm_mesh_to_original(w->s.mesh, 0, w->s.mesh->rest_m, w->s.mesh->rest_m), 0);
    BREAKS("tm_mesh_from_original", tm_mesh_from_original(w->s.mesh, 3, NULL, w->s.mesh->rest_m), 0);
    BREAKS("tm_mesh_numbering", tm_mesh_numbering(w->s.mesh, NULL));
    BREAKS("tm_mesh_numbering_tets", tm_mesh_numbering_tets(w->s.mesh, NULL, NULL));
    BREAKS("tm_mesh_numbering_measure", tm_mesh_numbering_measure(NULL, NULL));
}

static void broken_contract_of_tools_is_told(void **state) {
    const whole *w = *state;
    static tm_patch patch;
    tm_tool_pose pose = scene_pose(0, 0, 0.05), nowhere = pose;
    nowhere.tip_m[1] = NAN;
    BREAKS("tm_cut_fetch_removed", tm_cut_fetch_removed(w->s.world, NULL, NULL, 3));
    BREAKS("tm_contact_set_target", tm_contact_set_target(w->s.contact, 1, &pose, 10), 0);
    BREAKS("tm_contact_set_target", tm_contact_set_target(w->s.contact, -1, &pose, 10), 0);
    BREAKS("tm_contact_set_target", tm_contact_set_target(w->s.contact, 0, &nowhere, 10), 0);
    BREAKS("tm_contact_set_target", tm_contact_set_target(NULL, 0, &pose, 10), 0);
    nowhere.tip_m[1] = 0, nowhere.grip = INFINITY;
    BREAKS("tm_contact_set_pose", tm_contact_set_pose(w->s.contact, 0, &nowhere), 0);
    BREAKS("tm_contact_set_pose", tm_contact_set_pose(w->s.contact, 2, &pose), 0);
    BREAKS("tm_contact_pose", tm_contact_pose(w->s.contact, 7));
    BREAKS("tm_contact_reaction", tm_contact_reaction(w->s.contact, -1));
    BREAKS("tm_contact_begin_frame", tm_contact_begin_frame(w->s.contact, -1, 1), 0);
    BREAKS("tm_contact_rows", tm_contact_rows(w->s.contact, NULL));
    BREAKS("tm_grasp_vertices", tm_grasp_vertices(w->hold, 1, NULL, NULL));
    BREAKS("tm_grasp_vertices", tm_grasp_vertices(NULL, 0, NULL, NULL));
    BREAKS("tm_patch_compute", tm_patch_compute(w->maker, 5, &patch));
    BREAKS("tm_patch_pending", tm_patch_pending(NULL));
}

static void broken_contract_of_a_world_is_told(void **state) {
    const whole *w = *state;
    tm_error error;
    BREAKS("tm_world_step", tm_world_step(w->s.world, -1));
    BREAKS("tm_world_step", tm_world_step(NULL, 1));
    BREAKS("tm_world_state", tm_world_state(NULL));
    BREAKS("tm_world_hash", tm_world_hash(NULL));
    BREAKS("tm_world_remove_stage", tm_world_remove_stage(w->s.world, NULL, &error));
    BREAKS("tm_support_move", tm_support_move(w->s.world, 1 << 20, 0), 0);
    BREAKS("tm_support_move", tm_support_move(w->s.world, 0, NAN), 0);
    BREAKS("tm_support_mask", tm_support_mask(w->s.world, NULL), 0);
    BREAKS("tm_snapshot_bytes_max", tm_snapshot_bytes_max(NULL));
    BREAKS("tm_model_snapshot_bytes_max", tm_model_snapshot_bytes_max(NULL));
    BREAKS("tm_snapshot_save", tm_snapshot_save(w->s.world, NULL, 0, &error));
}

static void broken_contract_of_a_definition_is_told(void **state) {
    const whole *w = *state;
    tm_error error;
    tm_world_def world = {.tissue = w->s.tissue}; /* not filled by its _default function */
    tm_world *other = NULL;
    BREAKS("tm_world_create", tm_world_create(&world, &other, &error));
    world = tm_world_def_default();
    BREAKS("tm_world_create", tm_world_create(&world, &other, &error)); /* no tissue */
    world.tissue = w->s.tissue, world.size--;
    BREAKS("tm_world_create", tm_world_create(&world, &other, &error));
    assert_null(other);
    tm_stage stage = {.name = "nothing", .phase = TM_PHASE_END};
    BREAKS("tm_world_add_stage", tm_world_add_stage(w->s.world, &stage, 0, &error)); /* no size */
    stage.size = sizeof stage;
    BREAKS("tm_world_add_stage", tm_world_add_stage(w->s.world, &stage, 0, &error)); /* no run */
}

static void broken_contract_of_another_world_is_told(void **state) {
    whole *w = *state;
    tm_error error;
    const tm_grasp_def grasp = tm_grasp_def_default();
    const tm_patch_def patch_def = tm_patch_def_default();
    const scene_def def = scene_def_default();
    scene t = scene_create(&def);
    BREAKS("tm_stage_grasp", tm_stage_grasp(t.world, w->s.contact, &grasp, &w->hold, &error));
    BREAKS("tm_stage_patch", tm_stage_patch(t.world, w->s.contact, &patch_def, &w->maker, &error));
    scene_destroy(&t);
}

static void refused(tm_status status, int64_t entity, const tm_error *error) {
    assert_int_equal(status, TM_ERR_ARGUMENT);
    assert_int_equal(error->status, TM_ERR_ARGUMENT);
    assert_int_equal(error->entity, entity);
    assert_non_null(strstr(error->message, "; "));
}

static void data_out_of_range_return_their_index(void **state) {
    (void)state;
    static const double vertex[15] = {0, 0, 0, 0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0.01, 0.01, 0.01};
    static const int32_t tet[8] = {0, 1, 2, 3, 1, 2, 3, 4};
    tm_error error;
    tm_mesh_def mesh_def = tm_mesh_def_default();
    const int32_t region[2] = {0, INT32_MAX};
    mesh_def.vertex_count = 5, mesh_def.vertex_m = vertex, mesh_def.tet_count = 2, mesh_def.tet = tet;
    mesh_def.region = region;
    tm_mesh *mesh = NULL;
    assert_int_equal(tm_mesh_create(&mesh_def, &mesh, &error), TM_ERR_MESH);
    assert_int_equal(error.entity, 1);
    mesh_def.region = NULL;
    fix_ok(tm_mesh_create(&mesh_def, &mesh, &error), &error);
    tm_material material;
    fix_ok(tm_material_young(5e3, 0.4, &material, &error), &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material;
    tm_tissue *tissue = NULL;
    double extra[5] = {0, 0, 0, NAN, 0};
    def.extra_mass_kg = extra;
    refused(tm_tissue_create(&def, &tissue, &error), 3, &error);
    extra[3] = 0, extra[4] = -1;
    refused(tm_tissue_create(&def, &tissue, &error), 4, &error);
    def.extra_mass_kg = NULL, def.extra_damping_kg_s = extra;
    refused(tm_tissue_create(&def, &tissue, &error), 4, &error);
    def.extra_damping_kg_s = NULL, def.precision = (tm_precision)2;
    refused(tm_tissue_create(&def, &tissue, &error), -1, &error);
    def.precision = TM_DOUBLE, def.form = (tm_force_form)-1;
    refused(tm_tissue_create(&def, &tissue, &error), -1, &error);
    def.form = TM_FORCE_PLAIN;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    tm_world *world = fix_world(tissue, true);
    tm_support_def support = tm_support_def_default();
    support.count = -1;
    refused(tm_stage_support(world, &support, &error), -1, &error);
    static const int32_t dof[9] = {0, 1, 2, 3, 4, 5, 6, 7, 8};
    double value[9] = {0};
    support.count = 9, support.dof = dof, support.value_m = value;
    value[7] = NAN;
    refused(tm_stage_support(world, &support, &error), 2, &error);
    value[7] = 0;
    fix_ok(tm_stage_support(world, &support, &error), &error);
    tm_instrument_def tool = {
        .mode = (tm_tool_mode)9, .radius_m = 0.002, .contact_length_m = 0.1, .trocar_m = {0, 0, 1}};
    tm_contact_def contact_def = tm_contact_def_default();
    contact_def.instrument_count = 1, contact_def.instrument = &tool;
    tm_contact *contact = NULL;
    refused(tm_stage_contact(world, &contact_def, &contact, &error), 0, &error);
    /* Settling starts from finite numbers, or not at all. */
    tm_settle_def settle = tm_settle_def_default();
    tm_world_state(world)->u_m[3 * 4 + 1] = NAN;
    refused(tm_world_settle(world, &settle, NULL, &error), 4, &error);
    tm_world_state(world)->u_m[3 * 4 + 1] = 0;
    fix_ok(tm_world_settle(world, &settle, NULL, &error), &error);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
}

/* A stage with dependents cannot be removed. */
static void needed_stage_is_not_removed(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 4, def.cells[2] = 3;
    scene s = scene_create_full(&def, true, NULL);
    tm_error error;
    tm_grasp_def grasp = tm_grasp_def_default();
    tm_grasp *hold = NULL;
    tm_patch_def patch = tm_patch_def_default();
    tm_patch_builder *maker = NULL;
    tm_cut_def cut = tm_cut_def_default();
    fix_ok(tm_stage_grasp(s.world, s.contact, &grasp, &hold, &error), &error);
    fix_ok(tm_stage_patch(s.world, s.contact, &patch, &maker, &error), &error);
    fix_ok(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
    static const char *const order[] = {"cut", "grasp", "patch"};
    for (int i = 0; i < 3; i++) {
        assert_int_equal(tm_world_remove_stage(s.world, "contact", &error), TM_ERR_ARGUMENT);
        assert_non_null(strstr(error.message, "contact"));
        assert_non_null(strstr(error.message, order[i]));
        assert_int_equal(tm_world_step(s.world, 3), TM_OK);
        fix_ok(tm_world_remove_stage(s.world, order[i], &error), &error);
    }
    fix_ok(tm_world_remove_stage(s.world, "contact", &error), &error);
    assert_int_equal(tm_world_step(s.world, 3), TM_OK);
    tm_stage stage = {.size = sizeof stage, .name = "mine", .phase = TM_PHASE_END, .needs = {"contact"}};
    stage.run = (void (*)(void *, tm_world *))(uintptr_t)1; /* never called */
    assert_int_equal(tm_world_add_stage(s.world, &stage, 0, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "mine"));
    scene_destroy(&s);
}

static void count_up(void *self, tm_world *world) {
    (void)world;
    ++*(int *)self;
}

static void assert_stages(const tm_world *world, const char *const *name, int32_t count) {
    tm_stage_report report[TM_MAX_STAGES];
    assert_int_equal(tm_world_stages(world, report), count);
    for (int32_t i = 0; i < count; i++) assert_string_equal(report[i].name, name[i]);
}

static double seconds_of(const tm_world *world, const char *name) {
    tm_stage_report report[TM_MAX_STAGES];
    for (int32_t i = tm_world_stages(world, report) - 1; i >= 0; i--)
        if (!strcmp(report[i].name, name)) return report[i].seconds;
    return -1;
}

/* The list of stages is the step: substages are named, are added and removed with their stage, and each stage is
 * timed separately. */
static void list_of_stages_is_the_step(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 4, def.cells[2] = 3;
    scene s = scene_create_full(&def, true, (const tm_tool_mode[2]){TM_TOOL_GRASPER});
    tm_error error;
    tm_grasp_def grasp = tm_grasp_def_default();
    tm_grasp *hold = NULL;
    tm_patch_def patch_def = tm_patch_def_default();
    tm_patch_builder *maker = NULL;
    static tm_patch patch;
    fix_ok(tm_stage_patch(s.world, s.contact, &patch_def, &maker, &error), &error);
    fix_ok(tm_stage_grasp(s.world, s.contact, &grasp, &hold, &error), &error);
    static const char *const full[] = {"contact",        "force",         "integrate",      "support", "grasp",
                                       "contact detect", "contact solve", "contact forces", "patch"};
    assert_stages(s.world, full, 9);
    tm_world_set_timing(s.world, true);
    assert_int_equal(tm_world_step(s.world, 3), TM_OK);
    assert_true(seconds_of(s.world, "patch") == 0);
    for (int i = 0; i < 8; i++) assert_true(seconds_of(s.world, full[i]) > 0);
    const double constrain_s = seconds_of(s.world, "contact solve");
    tm_patch_compute(maker, 0, &patch);
    assert_true(seconds_of(s.world, "patch") > 0 && seconds_of(s.world, "contact solve") == constrain_s);

    assert_int_equal(tm_world_remove_stage(s.world, "contact detect", &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "remove contact"));
    int runs = 0;
    tm_stage mine = {.size = sizeof mine, .name = "mine", .phase = TM_PHASE_CONSTRAIN, .run = count_up, .self = &runs};
    mine.runs_before = "force";
    assert_int_equal(tm_world_add_stage(s.world, &mine, 0, &error), TM_ERR_ARGUMENT); /* of another phase */
    mine.runs_before = "nothing";
    assert_int_equal(tm_world_add_stage(s.world, &mine, 0, &error), TM_ERR_ARGUMENT);
    mine.runs_before = NULL, mine.substage_of = "contact forces";
    assert_int_equal(tm_world_add_stage(s.world, &mine, 0, &error), TM_ERR_ARGUMENT); /* a substage of a substage */
    mine.substage_of = NULL, mine.needs[0] = "contact forces";
    assert_int_equal(tm_world_add_stage(s.world, &mine, 0, &error),
                     TM_ERR_ARGUMENT); /* which is removed with its stage */
    mine.needs[0] = NULL, mine.substage_of = "contact", mine.runs_before = "contact forces";
    fix_ok(tm_world_add_stage(s.world, &mine, 0, &error), &error);
    assert_int_equal(tm_world_step(s.world, 3), TM_OK);
    assert_int_equal(runs, 3);
    fix_ok(tm_world_remove_stage(s.world, "patch", &error), &error);
    fix_ok(tm_world_remove_stage(s.world, "grasp", &error), &error);
    fix_ok(tm_world_remove_stage(s.world, "contact", &error), &error);
    assert_stages(s.world, full + 1, 3);
    assert_int_equal(tm_world_step(s.world, 3), TM_OK);
    assert_int_equal(runs, 3);

    tm_set_contract_handler(on_broken, &broken);
    mine = (tm_stage){.size = sizeof mine, .name = "mine", .phase = TM_PHASE_ON_DEMAND, .run = count_up, .self = &runs};
    BREAKS("tm_world_add_stage", tm_world_add_stage(s.world, &mine, 0, &error));
    mine.phase = TM_PHASE_END, mine.run = NULL;
    BREAKS("tm_world_add_stage", tm_world_add_stage(s.world, &mine, 0, &error));
    mine.run = count_up, mine.divided = true; /* no range to divide */
    BREAKS("tm_world_add_stage", tm_world_add_stage(s.world, &mine, 0, &error));
    tm_set_contract_handler(NULL, NULL);
    scene_destroy(&s);
}

/* A tool that outruns contact detection is flagged; one that moves less than half its radius per substep is not. */
static void tool_that_outruns_contact_is_flagged(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 4, def.cells[2] = 3;
    scene s = scene_create(&def);
    const double dt = tm_world_step_s(s.world);
    tm_tool_reaction r = scene_frame(&s, 0, scene_pose(0.01, 0.005, 0.06 - 20 * 0.4 * 0.0025), 20 * dt);
    assert_false(r.flags & TM_REACTION_TOO_FAST);
    r = scene_frame(&s, 0, scene_pose(0.01, 0.005, -0.02), 4 * dt);
    assert_true(r.flags & TM_REACTION_TOO_FAST);
    r = scene_frame(&s, 0, scene_pose(0.01, 0.005, -0.02), 4 * dt);
    assert_false(r.flags & TM_REACTION_TOO_FAST);
    scene_destroy(&s);
}

static bool no_number(void *self, int32_t a, int32_t b, double C[9]) {
    (void)a, (void)b;
    for (int i = 0; i < 9; i++) C[i] = i % 4 ? 0 : *(double *)self;
    return true;
}

/* Omissions are reported, and an impossible patch is empty. */
static void omissions_are_reported(void **state) {
    (void)state;
    scene_def def = scene_def_default();
    scene s = scene_create(&def);
    const tm_surface_view f = tm_tissue_surface(s.tissue);
    const tm_capsule tool = {.tip_m = {0.01, 0.005, 0.0425}, .tail_m = {-0.03, 0.005, 0.0425}, .radius_m = 0.0025};
    tm_contact_row row[64];
    bool overflowed = false;
    const double *u = tm_world_state(s.world)->u_m;
    const int32_t all =
        fix_find(s.mesh->rest_m, u, f.triangle, f.face, NULL, f.count, &tool, 5e-4, row, 64, &overflowed);
    assert_true(all > 3 && !overflowed);
    assert_int_equal(fix_find(s.mesh->rest_m, u, f.triangle, f.face, NULL, f.count, &tool, 5e-4, row, 3, &overflowed),
                     3);
    assert_true(overflowed);
    static tm_patch patch;
    const double still[3] = {0};
    double c = -1e-3;
    assert_true(tm_patch_choose(s.mesh->rest_m, u, &f, &tool, still, 0, NULL, 0, 12, 16, &patch) > 0);
    assert_false(tm_patch_fill(&patch, no_number, &c, NULL, 0)); /* negative */
    c = NAN;
    assert_false(tm_patch_fill(&patch, no_number, &c, NULL, 0));
    c = 1e-3;
    scene_destroy(&s);
}

#define TOLD(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void) {
    const struct CMUnitTest tests[] = {TOLD(broken_contract_of_jaws_is_told),
                                       TOLD(broken_contract_of_the_search_is_told),
                                       TOLD(broken_contract_of_the_patch_solver_is_told),
                                       TOLD(broken_contract_of_tissue_is_told),
                                       TOLD(broken_contract_of_a_mesh_is_told),
                                       TOLD(broken_contract_of_tools_is_told),
                                       TOLD(broken_contract_of_a_world_is_told),
                                       TOLD(broken_contract_of_a_definition_is_told),
                                       TOLD(broken_contract_of_another_world_is_told),
                                       cmocka_unit_test(data_out_of_range_return_their_index),
                                       cmocka_unit_test(needed_stage_is_not_removed),
                                       cmocka_unit_test(list_of_stages_is_the_step),
                                       cmocka_unit_test(tool_that_outruns_contact_is_flagged),
                                       cmocka_unit_test(omissions_are_reported)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
