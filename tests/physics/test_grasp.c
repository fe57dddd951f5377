/* Grasping: grasping, pulling, releasing, two graspers on the same tissue and a cut between them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "contact_scene.h"

static double norm(const double *a) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

static const tm_tool_mode GRASPERS[2] = {TM_TOOL_GRASPER, TM_TOOL_GRASPER};

typedef struct grasp_scene {
    scene s;
    tm_grasp *grasp;
} grasp_scene;

static grasp_scene open_scene(scene_def *d, bool cuttable) {
    grasp_scene g = {.s = scene_create_full(d, cuttable, GRASPERS)};
    tm_grasp_def def = tm_grasp_def_default();
    tm_error error;
    scene_must(tm_stage_grasp(g.s.world, g.s.contact, &def, &g.grasp, &error), &error);
    return g;
}

static tm_tool_pose with_grip(tm_tool_pose pose, double grip) {
    pose.grip = grip;
    return pose;
}

/* Runs one frame of 5 ms in which both tools move to their targets; forces are averaged over the complete frame. */
static void frame(grasp_scene *g, const tm_tool_pose *to, double force_N[2][3]) {
    int32_t n = (int32_t)ceil(0.005 / tm_world_step_s(g->s.world));
    tm_contact_begin_frame(g->s.contact, n, n);
    for (int t = 0; t < g->s.def.tools; t++) tm_contact_set_target(g->s.contact, t, to + t, n);
    assert_int_equal(tm_world_step(g->s.world, n), TM_OK);
    for (int t = 0; t < g->s.def.tools; t++)
        memcpy(force_N[t], tm_contact_reaction(g->s.contact, t).force_N, sizeof force_N[t]);
}

static scene_def small_block(int tools) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 8, d.cells[2] = 4;
    d.tools = tools;
    d.damping_1_s = 200;
    memcpy(d.tip_m, (double[2][3]){{0.008, 0.004, 0.0447}, {-0.008, 0.004, 0.0447}}, sizeof d.tip_m);
    return d;
}

/* Presses a little, closes, pulls 6 mm up: the tool is pulled down by the tissue's own elastic force. After opening,
 * the force falls monotonically and is zero within the stated time, and nothing is grasped any more. */
static void test_grasp_pull_and_release(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    grasp_scene g = open_scene(&d, false);
    tm_grasp_state state;
    double force[2][3], before[3], worst_jump = 0;
    tm_tool_pose at = scene_pose(0.008, 0.004, 0.0437);
    for (int k = 0; k < 40; k++) frame(&g, &at, force);
    assert_int_equal(tm_grasp_vertices(g.grasp, 0, NULL, &state), 0);
    assert_true(force[0][2] > 0.02);
    for (int k = 1; k <= 10; k++) { /* closing changes no force: the grasp takes over the load of contact */
        memcpy(before, force[0], sizeof before);
        at = with_grip(at, 0.1 * k);
        frame(&g, &at, force);
        double change[3] = {force[0][0] - before[0], force[0][1] - before[1], force[0][2] - before[2]};
        worst_jump = fmax(worst_jump, norm(change));
    }
    int32_t held = tm_grasp_vertices(g.grasp, 0, NULL, &state);
    assert_true(held >= 3 && state == TM_GRASP_HOLDING);
    print_message("%d vertices held; closing changed the force by at most %.1e N of %.3f N\n", held, worst_jump,
                  norm(force[0]));
    assert_true(worst_jump < 0.02 * norm(force[0]));
    for (int k = 1; k <= 120; k++) {
        at.tip_m[2] = 0.0437 + 0.006 * fmin(k / 60.0, 1);
        frame(&g, &at, force);
    }
    double *f = calloc((size_t)(3 * g.s.mesh->vertex_count), sizeof(double)), elastic = 0;
    tm_tissue_force(g.s.tissue, tm_world_state(g.s.world)->u_m, f);
    for (int32_t v = 0; v < g.s.mesh->vertex_count; v++)
        elastic += g.s.mesh->rest_m[3 * v + 2] > 1e-9 ? f[3 * v + 2] : 0;
    free(f);
    tm_tool_reaction r = tm_contact_reaction(g.s.contact, 0);
    print_message("pulled 6 mm: %.4f N on the tool, elastic force %.4f N\n", r.resultant_N[2], elastic);
    assert_true(r.resultant_N[2] < -0.05);
    assert_true(fabs(r.resultant_N[2] - elastic) < 1e-3 * fabs(elastic));
    at.grip = 0.2; /* below 0.3: opens */
    double last = norm(force[0]), time_to_zero = -1;
    for (int k = 1; k <= 60; k++) {
        frame(&g, &at, force);
        assert_true(norm(force[0]) <= last + 1e-12);
        last = norm(force[0]);
        if (last == 0 && time_to_zero < 0) time_to_zero = 0.005 * k;
    }
    print_message("opened: zero after %.0f ms\n", 1e3 * time_to_zero);
    assert_true(time_to_zero > 0.05 && time_to_zero <= 0.1 + 0.010);
    assert_int_equal(tm_grasp_vertices(g.grasp, 0, NULL, &state), 0);
    assert_int_equal(state, TM_GRASP_OPEN);
    scene_destroy(&g.s);
}

/* Half a turn of roll twists the tissue and creates no net force; between the two thresholds the jaw state stays
 * unchanged. */
static void test_roll_twists_without_net_force(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    grasp_scene g = open_scene(&d, false);
    double force[2][3];
    tm_tool_pose at = with_grip(scene_pose(0.008, 0.004, 0.0437), 1);
    for (int k = 0; k < 40; k++) frame(&g, &at, force);
    double energy = tm_tissue_energy(g.s.tissue, tm_world_state(g.s.world)->u_m);
    at.grip = 0.5;
    for (int k = 0; k < 60; k++) {
        at.roll_rad = 0.6 * fmin(k / 30.0, 1);
        frame(&g, &at, force);
    }
    tm_grasp_state state;
    assert_true(tm_grasp_vertices(g.grasp, 0, NULL, &state) >= 3 && state == TM_GRASP_HOLDING);
    double twisted = tm_tissue_energy(g.s.tissue, tm_world_state(g.s.world)->u_m);
    print_message("roll of 0.6 rad: energy %.2e J to %.2e J\n", energy, twisted);
    assert_true(twisted > 2 * energy);
    scene_destroy(&g.s);
}

/* Two graspers hold the same tissue and pull apart; the tetrahedra between them are cut: each force falls to its own
 * new value. */
static void test_cut_between_two_graspers_ends_their_pull(void **unused) {
    (void)unused;
    scene_def d = small_block(2);
    grasp_scene g = open_scene(&d, true);
    double force[2][3];
    tm_tool_pose at[2] = {scene_pose(0.008, 0.004, 0.0437), scene_pose(-0.008, 0.004, 0.0437)};
    for (int k = 0; k < 30; k++) {
        at[0].grip = at[1].grip = fmin(0.05 * k, 1);
        frame(&g, at, force);
    }
    for (int k = 1; k <= 100; k++) {
        at[0].tip_m[0] = 0.008 + 0.006 * fmin(k / 50.0, 1); /* only tool 0 moves away */
        frame(&g, at, force);
    }
    double pulled[2] = {force[0][0], force[1][0]};
    print_message("one pulls 6 mm away: %.3f N and %.3f N along the line between\n", pulled[0], pulled[1]);
    assert_true(pulled[0] < -0.05 && pulled[1] > 0.01 && -pulled[0] > pulled[1]);
    int32_t *tet = malloc(sizeof(int32_t) * (size_t)g.s.mesh->tet_count), count = 0;
    for (int32_t t = 0; t < g.s.mesh->tet_count; t++) {
        double x = 0, z = 0;
        for (int j = 0; j < 4; j++)
            x += g.s.mesh->rest_m[3 * g.s.mesh->tet[4 * t + j]] / 4,
                z += g.s.mesh->rest_m[3 * g.s.mesh->tet[4 * t + j] + 2] / 4;
        if (fabs(x) < 0.004 && z > 0.02) tet[count++] = t;
    }
    assert_true(count > 20);
    assert_true(tm_cut_remove(g.s.tissue, tet, count, NULL, 0) >= count);
    free(tet);
    for (int k = 0; k < 100; k++) frame(&g, at, force);
    print_message("after the cut between them: %.3f N and %.3f N\n", force[0][0], force[1][0]);
    assert_true(fabs(force[0][0]) < 0.95 * fabs(pulled[0]));
    assert_true(fabs(force[1][0]) < 0.7 * fabs(pulled[1]));
    assert_true(tm_grasp_vertices(g.grasp, 0, NULL, NULL) >= 3 && tm_grasp_vertices(g.grasp, 1, NULL, NULL) >= 3);
    scene_destroy(&g.s);
}

/* All tissue around the grasped vertices is removed: they are released, and the tool's force is 0. */
static void test_removed_vertices_are_released(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    grasp_scene g = open_scene(&d, true);
    double force[2][3];
    tm_tool_pose at = with_grip(scene_pose(0.008, 0.004, 0.0437), 1);
    for (int k = 0; k < 20; k++) frame(&g, &at, force);
    const int32_t *vertex;
    int32_t held = tm_grasp_vertices(g.grasp, 0, &vertex, NULL), n = 0;
    assert_true(held >= 3);
    int32_t *tet = malloc(sizeof(int32_t) * (size_t)g.s.mesh->tet_count);
    for (int32_t t = 0; t < g.s.mesh->tet_count; t++)
        for (int j = 0; j < 4; j++) {
            bool mine = false;
            for (int32_t i = 0; i < held; i++) mine = mine || g.s.mesh->tet[4 * t + j] == vertex[i];
            if (mine) {
                tet[n++] = t;
                break;
            }
        }
    tm_cut_remove(g.s.tissue, tet, n, NULL, 0);
    free(tet);
    at.tip_m[2] += 0.004; /* away from the hole's rim */
    frame(&g, &at, force);
    assert_int_equal(tm_grasp_vertices(g.grasp, 0, NULL, NULL), 0);
    for (int k = 0; k < 20; k++) frame(&g, &at, force);
    assert_true(norm(force[0]) == 0);
    scene_destroy(&g.s);
}

/* A grasper whose pose is set elsewhere releases its vertices; the tissue is not thrown. */
static void test_setting_the_pose_releases_the_grasp(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    grasp_scene g = open_scene(&d, false);
    double force[2][3];
    tm_tool_pose at = with_grip(scene_pose(0.008, 0.004, 0.0437), 1);
    for (int k = 0; k < 20; k++) frame(&g, &at, force);
    assert_true(tm_grasp_vertices(g.grasp, 0, NULL, NULL) >= 3);
    at.tip_m[2] = 0.08;
    tm_contact_set_pose(g.s.contact, 0, &at);
    for (int k = 0; k < 4; k++) {
        frame(&g, &at, force);
        assert_true(norm(force[0]) == 0);
    }
    assert_int_equal(tm_grasp_vertices(g.grasp, 0, NULL, NULL), 0);
    scene_destroy(&g.s);
}

/* A scene without grasping costs nothing for it; its graspers act as probes. */
/* A jaw that was driven deep into the tissue closes: its springs store no more than the rows' compliance did. */
static void test_closing_deep_in_the_tissue_generates_no_energy(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    d.cells[0] = d.cells[1] = 3, d.cells[2] = 2;
    grasp_scene g = open_scene(&d, false);
    tm_error error;
    tm_grasp_state state;
    scene_must(tm_stage_energy(g.s.world, &error), &error);
    double force[2][3], most_J = 0;
    tm_tool_pose at = scene_pose(0, 0, 0.0447);
    for (int k = 1; k <= 3; k++) at.tip_m[2] -= 0.007, frame(&g, &at, force);
    tm_energy before, e;
    assert_int_equal(tm_world_energy(g.s.world, &before, NULL), TM_OK);
    at.grip = 1;
    for (int k = 0; k < 4; k++) {
        frame(&g, &at, force);
        assert_int_equal(tm_world_energy(g.s.world, &e, NULL), TM_OK);
        most_J = fmax(most_J, e.generated_J - e.drag_J - before.generated_J + before.drag_J);
    }
    assert_true(tm_grasp_vertices(g.grasp, 0, NULL, &state) > 0);
    print_message("closing generated at most %.2g J where %.2g J were stored\n", most_J,
                  before.elastic_J + before.contact_stored_J);
    assert_true(most_J < 0.005 * (before.elastic_J + before.contact_stored_J));
    scene_destroy(&g.s);
}

static void test_costs_nothing_unless_named(void **unused) {
    (void)unused;
    scene_def d = small_block(1);
    scene s = scene_create_full(&d, false, GRASPERS);
    int64_t without = tm_memory_in_use();
    tm_stage_report report[TM_MAX_STAGES];
    for (int32_t i = 0, n = tm_world_stages(s.world, report); i < n; i++)
        assert_string_not_equal(report[i].name, "grasp");
    tm_grasp_def def = tm_grasp_def_default();
    tm_grasp *grasp;
    tm_error error;
    scene_must(tm_stage_grasp(s.world, s.contact, &def, &grasp, &error), &error);
    int64_t named = 0;
    for (int32_t i = 0, n = tm_world_stages(s.world, report); i < n; i++)
        named += strcmp(report[i].name, "grasp") ? 0 : report[i].bytes;
    assert_true(named > 0 && tm_memory_in_use() - without == named);
    assert_int_equal(tm_stage_grasp(s.world, s.contact, &def, &grasp, &error), TM_ERR_ARGUMENT);
    scene_destroy(&s);
    s = scene_create_full(&d, false, GRASPERS);
    tm_grasp_def bad = def;
    bad.open_grip = 0.8;
    assert_int_equal(tm_stage_grasp(s.world, s.contact, &bad, &grasp, &error), TM_ERR_ARGUMENT);
    bad = def;
    bad.compliance_m_N = 0;
    assert_int_equal(tm_stage_grasp(s.world, s.contact, &bad, &grasp, &error), TM_ERR_ARGUMENT);
    scene_destroy(&s);
    assert_true(tm_memory_in_use() == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_grasp_pull_and_release),
        cmocka_unit_test(test_roll_twists_without_net_force),
        cmocka_unit_test(test_cut_between_two_graspers_ends_their_pull),
        cmocka_unit_test(test_removed_vertices_are_released),
        cmocka_unit_test(test_setting_the_pose_releases_the_grasp),
        cmocka_unit_test(test_closing_deep_in_the_tissue_generates_no_energy),
        cmocka_unit_test(test_costs_nothing_unless_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
