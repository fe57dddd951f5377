/* The surface patch and the contact stiffness of the dynamic model, against settled solves. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

static double norm(const double *a) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }
static double distance(const double *a, const double *b) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return norm(d);
}

typedef struct patch_scene {
    scene s;
    tm_patch_builder *maker;
    tm_patch patch;
    double tip_m[3];
} patch_scene;

/* Returns the settled solve's force with the tip there; leaves the tissue at that equilibrium. */
static void settled(scene *s, const double tip_m[3], double force_N[3]) {
    tm_tool_pose at = scene_pose(tip_m[0], tip_m[1], tip_m[2]);
    tm_contact_set_target(s->contact, 0, &at, 1);
    assert_int_equal(tm_world_step(s->world, 1), TM_OK);
    tm_settle_def settle = tm_settle_def_default();
    settle.tolerance = 1e-8;
    tm_error error;
    scene_must(tm_world_settle(s->world, &settle, NULL, &error), &error);
    tm_contact_begin_frame(s->contact, 1, 1);
    assert_int_equal(tm_world_step(s->world, 1), TM_OK);
    memcpy(force_N, tm_contact_reaction(s->contact, 0).force_N, 3 * sizeof(double));
}

static int make(patch_scene *p) {
    int calls = 0;
    bool made = false;
    do {
        made = tm_patch_compute(p->maker, 0, &p->patch);
    } while (tm_patch_pending(p->maker) > 0 && ++calls < 500);
    assert_true(made);
    return calls;
}

static patch_scene press(double bulge_m, double x, double y, double depth_m, bool cuttable) {
    patch_scene p;
    scene_def d = scene_def_default();
    d.bulge_m = bulge_m;
    d.trocar_m[0][0] = 0.1;
    double top = d.size_m[2] + bulge_m, tip[3] = {x, y, top + 0.0025 - depth_m};
    memcpy(d.tip_m[0], (double[3]){x, y, top + 0.0027}, sizeof d.tip_m[0]);
    memcpy(p.tip_m, tip, sizeof tip);
    p.s = scene_create_full(&d, cuttable, NULL);
    tm_patch_def def = tm_patch_def_default();
    tm_error error;
    scene_must(tm_stage_patch(p.s.world, p.s.contact, &def, &p.maker, &error), &error);
    scene_frame(&p.s, 0, scene_pose(tip[0], tip[1], tip[2]), 0.5);
    return p;
}

static void chosen_well(const patch_scene *p) {
    const tm_patch *patch = &p->patch;
    assert_true(patch->vertex_count <= 24 && patch->triangle_count <= 32 && patch->triangle_count > 12);
    for (int32_t t = 0; t < patch->triangle_count; t++) {
        int shared = 0;
        for (int32_t o = 0; o < patch->triangle_count; o++) {
            int common = 0;
            for (int k = 0; k < 9; k++) common += patch->triangle[3 * t + k / 3] == patch->triangle[3 * o + k % 3];
            shared += o != t && common == 2;
        }
        assert_true(shared >= 1); /* connected, edge to edge */
    }
    double x[TM_PATCH_DOFS], sum = 0;
    scene_seed = 11;
    for (int k = 0; k < 50; k++, sum = 0) { /* no load gains energy from it */
        for (int32_t i = 0; i < 3 * patch->vertex_count; i++) x[i] = 2 * scene_random() - 1;
        for (int32_t i = 0; i < 3 * patch->vertex_count; i++)
            for (int32_t j = 0; j < 3 * patch->vertex_count; j++) sum += x[i] * x[j] * tm_patch_compliance(patch, i, j);
        assert_true(sum > 0);
    }
}

/* At P_n the patch gives the model's force; K is the derivative of settled forces; moved by up to 1 mm the patch
 * follows the settled force. */
static void patch_against_settled(patch_scene *p, const char *what, double stiffness_within, double force_within) {
    double force[3], at_tip[3], K[9], step = 5e-5, wrong = 0, size = 0, worst = 0, worst_tangent = 0, worst_hold = 0;
    bool inside;
    settled(&p->s, p->tip_m, force);
    make(p);
    chosen_well(p);
    tm_tool_reaction r = tm_contact_reaction(p->s.contact, 0);
    assert_int_equal(r.stiffness_kind, 1);
    tm_patch_solver *solver;
    tm_error error;
    scene_must(tm_patch_solver_create(&solver, &error), &error);
    tm_patch_force(solver, &p->patch, p->tip_m, at_tip, &inside);
    assert_true(inside && distance(at_tip, force) < 1e-4 * norm(force));
    for (int c = 0; c < 3; c++) {
        double ahead[3], behind[3], at[3];
        memcpy(at, p->tip_m, sizeof at);
        at[c] += step;
        settled(&p->s, at, ahead);
        at[c] -= 2 * step;
        settled(&p->s, at, behind);
        for (int i = 0; i < 3; i++) K[3 * i + c] = (ahead[i] - behind[i]) / (2 * step);
    }
    for (int i = 0; i < 9; i++) wrong += (K[i] - r.stiffness_N_m[i]) * (K[i] - r.stiffness_N_m[i]), size += K[i] * K[i];
    static const double moves[5][3] = {
        {0.0005, 0, 0}, {-0.001, 0, 0}, {0, 0.001, 0}, {0, 0, -0.001}, {0.0005, -0.0005, 0.001}};
    for (int k = 0; k < 5; k += test_is_sanitized() ? 4 : 1) {
        double at[3], truth[3], patch[3], tangent[3];
        for (int c = 0; c < 3; c++) at[c] = p->tip_m[c] + moves[k][c];
        settled(&p->s, at, truth);
        tm_patch_force(solver, &p->patch, at, patch, NULL);
        for (int i = 0; i < 3; i++)
            tangent[i] = force[i] + r.stiffness_N_m[3 * i] * moves[k][0] + r.stiffness_N_m[3 * i + 1] * moves[k][1] +
                         r.stiffness_N_m[3 * i + 2] * moves[k][2];
        worst = fmax(worst, distance(patch, truth));
        worst_tangent = fmax(worst_tangent, distance(tangent, truth));
        worst_hold = fmax(worst_hold, distance(force, truth));
    }
    print_message(
        "%s: %.3f N; stiffness off by %.2f %%; moved up to 1.2 mm: patch off by %.3f %%, tangent %.2f %%, hold %.1f %%\n",
        what, norm(force), 100 * sqrt(wrong / size), 100 * worst / norm(force), 100 * worst_tangent / norm(force),
        100 * worst_hold / norm(force));
    /* A disc of some millimetres on tissue with shear waves of 1.3 m/s. */
    print_message("%s: waves carry off %.3f N s/m, within %.1f ms\n", what, p->patch.radiation_N_s_m,
                  1e3 * p->patch.radiation_s);
    assert_true(p->patch.radiation_N_s_m > 0.02 && p->patch.radiation_N_s_m < 0.4);
    assert_true(p->patch.radiation_s > 1e-3 && p->patch.radiation_s < 0.02);
    assert_true(sqrt(wrong / size) < stiffness_within);
    assert_true(worst < force_within * norm(force));
    assert_true(worst < 0.2 * worst_tangent && worst_tangent < worst_hold);
    tm_patch_solver_destroy(solver);
}

static void test_patch_follows_settled_tissue(void **unused) {
    (void)unused;
    if (!test_is_sanitized()) {
        patch_scene flat = press(0, 0.003, 0.004, 0.0042, false);
        patch_against_settled(&flat, "flat", 0.01, 0.003);
        scene_destroy(&flat.s);
    }
    patch_scene curved = press(0.01, -0.006, 0.004, 0.0042, false);
    patch_against_settled(&curved, "curved", 0.02, 0.01);
    scene_destroy(&curved.s);
}

/* Cuts a slit across the top, some 15 mm off the middle. */
static void cut_slit(scene *s) {
    const tm_mesh *mesh = s->mesh;
    int32_t n = 0, *tet = malloc(sizeof(int32_t) * (size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x = 0, z = 0;
        for (int j = 0; j < 4; j++)
            x += mesh->rest_m[3 * mesh->tet[4 * t + j]] / 4, z += mesh->rest_m[3 * mesh->tet[4 * t + j] + 2] / 4;
        if (x > -0.018 && x < -0.012 && z > 0.018) tet[n++] = t;
    }
    assert_true(tm_cut_remove(s->tissue, tet, n, NULL, 0) >= n);
    free(tet);
}

/* A cut near the tool: the columns are recomputed from the old ones, and the patch is as accurate as before. */
static void test_patch_after_a_cut(void **unused) {
    (void)unused;
    patch_scene p = press(0, 0.003, 0.004, 0.0042, true);
    int fresh = make(&p);
    int32_t revision = p.patch.topology_revision;
    cut_slit(&p.s);
    scene_frame(&p.s, 0, tm_contact_pose(p.s.contact, 0), 0.2);
    tm_patch now;
    tm_patch_compute(p.maker, 0, &now);
    assert_true(tm_patch_pending(p.maker) > 0); /* stiffness has changed: no old column is sent as new */
    int again = make(&p);
    assert_true(p.patch.topology_revision > revision);
    print_message("calls of tm_patch_compute until all columns are there: %d at first, %d after the cut\n", fresh,
                  again);
    patch_against_settled(&p, "beside a cut", 0.01, 0.005);
    scene_destroy(&p.s);
}

/* Over a slit's lip tissue snaps from one equilibrium to another. A stiffness is that of the model's present
 * equilibrium, whichever the previous frame had: a difference across both would look like thousands of newtons per
 * metre. */
static void test_stiffness_on_the_lip_of_a_slit(void **unused) {
    (void)unused;
    patch_scene p = press(0, -0.0138, 0.004, 0.0042, true);
    cut_slit(&p.s);
    double most = 0, least = INFINITY;
    for (int k = 0; k < 12; k++) { /* it snaps between the eleventh and the twelfth place */
        const double x = p.tip_m[0] - 0.0001 * k;
        scene_frame(&p.s, 0, scene_pose(x, p.tip_m[1], p.tip_m[2]), 0.02);
        make(&p);
        const tm_tool_reaction r = tm_contact_reaction(p.s.contact, 0);
        double size = 0;
        for (int i = 0; i < 9; i++) size += r.stiffness_N_m[i] * r.stiffness_N_m[i];
        most = fmax(most, sqrt(size));
        if (k < 9) least = fmin(least, sqrt(size));
    }
    print_message("towards the snap: stiffness %.0f to %.0f N/m\n", least, most);
    assert_true(least > 45 && most < 300); /* the other equilibrium has 30 */
    scene_destroy(&p.s);
}

static void hold_at(scene *s, const double tip_m[3], double seconds, double force_N[3]) {
    tm_tool_pose at = scene_pose(tip_m[0], tip_m[1], tip_m[2]);
    at.grip = 1;
    memcpy(force_N, scene_frame(s, 0, at, seconds).force_N, 3 * sizeof(double));
}

/* Returns the settled solve with the jaws there: a grasp's springs do not slip, so the path does not matter. */
static void rest_at(scene *s, const double tip_m[3], double force_N[3]) {
    hold_at(s, tip_m, 0.01, force_N);
    hold_at(s, tip_m, 0.5, force_N);
    hold_at(s, tip_m, 0.002, force_N);
}

/* A grasper that pulls, or presses tissue next to its jaws, against the simulation at rest: the patch contains the
 * grasped vertices. */
static void patch_of_a_hold(const char *what, const double trocar_m[3], const double to_m[3], bool presses) {
    static const tm_tool_mode mode[2] = {TM_TOOL_GRASPER, TM_TOOL_GRASPER};
    static const double moves[5][3] = {
        {0.0005, 0, 0}, {-0.001, 0, 0}, {0, 0.001, 0}, {0, 0, -0.001}, {0.0005, -0.0005, 0.001}};
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = presses ? 12 : 8, d.cells[2] = 4;
    d.damping_1_s = 300;
    memcpy(d.trocar_m[0], trocar_m, sizeof d.trocar_m[0]);
    double tip[3] = {0.008, 0.004, 0.0437}, force[3], patch_N[3], K[9], wrong = 0, size = 0;
    double worst = 0, worst_tangent = 0, worst_hold = 0;
    memcpy(d.tip_m[0], (double[3]){0.008, 0.004, 0.0447}, sizeof d.tip_m[0]);
    patch_scene p = {.s = scene_create_full(&d, false, mode)};
    tm_grasp_def grasp_def = tm_grasp_def_default();
    if (presses) grasp_def.jaw_length_m = 0.002;
    tm_patch_def def = tm_patch_def_default();
    tm_grasp *grasp;
    tm_error error;
    tm_patch_solver *solver;
    scene_must(tm_patch_solver_create(&solver, &error), &error);
    scene_must(tm_stage_grasp(p.s.world, p.s.contact, &grasp_def, &grasp, &error), &error);
    scene_must(tm_stage_patch(p.s.world, p.s.contact, &def, &p.maker, &error), &error);
    scene_frame(&p.s, 0, scene_pose(tip[0], tip[1], tip[2]), 0.3);
    hold_at(&p.s, tip, 0.1, force);
    assert_true(tm_grasp_vertices(grasp, 0, NULL, NULL) >= 3);
    for (int c = 0; c < 3; c++) tip[c] += to_m[c];
    rest_at(&p.s, tip, force);
    make(&p);
    tm_tool_reaction r = tm_contact_reaction(p.s.contact, 0);
    assert_int_equal(r.stiffness_kind, 1);
    assert_true(p.patch.grasps && p.patch.grasped != 0 && p.patch.vertex_count < TM_PATCH_VERTICES);
    tm_patch_force(solver, &p.patch, tip, patch_N, NULL);
    const double beside_N = distance(p.patch.grasp_N, patch_N);
    assert_true(distance(patch_N, force) < 1e-3 * norm(force));
    assert_true(presses ? beside_N > 0.02 * norm(force) : beside_N < 1e-9);
    for (int c = 0; c < 3; c++) {
        double ahead[3], behind[3], at[3];
        memcpy(at, tip, sizeof at);
        at[c] = tip[c] + 1e-4;
        rest_at(&p.s, at, ahead);
        at[c] = tip[c] - 1e-4;
        rest_at(&p.s, at, behind);
        for (int i = 0; i < 3; i++) K[3 * i + c] = (ahead[i] - behind[i]) / 2e-4;
    }
    for (int i = 0; i < 9; i++) wrong += (K[i] - r.stiffness_N_m[i]) * (K[i] - r.stiffness_N_m[i]), size += K[i] * K[i];
    for (int k = 0; k < 5; k += test_is_sanitized() ? 4 : 1) {
        double at[3], truth[3], tangent[3];
        for (int c = 0; c < 3; c++) at[c] = tip[c] + moves[k][c];
        rest_at(&p.s, at, truth);
        tm_patch_force(solver, &p.patch, at, patch_N, NULL);
        for (int i = 0; i < 3; i++)
            tangent[i] = force[i] + r.stiffness_N_m[3 * i] * moves[k][0] + r.stiffness_N_m[3 * i + 1] * moves[k][1] +
                         r.stiffness_N_m[3 * i + 2] * moves[k][2];
        worst = fmax(worst, distance(patch_N, truth));
        worst_tangent = fmax(worst_tangent, distance(tangent, truth));
        worst_hold = fmax(worst_hold, distance(force, truth));
    }
    print_message(
        "%s: %.3f N, %.3f N of it beside the jaws; stiffness off by %.2f %%; moved up to 1.2 mm: patch off by "
        "%.3f %%, tangent %.2f %%, hold %.1f %%\n",
        what, norm(force), beside_N, 100 * sqrt(wrong / size), 100 * worst / norm(force),
        100 * worst_tangent / norm(force), 100 * worst_hold / norm(force));
    assert_true(sqrt(wrong / size) < 0.03);
    assert_true(worst < 0.002 * norm(force) && worst < 0.01 * worst_hold);
    assert_true(!presses || worst < 0.3 * worst_tangent);
    tm_patch_solver_destroy(solver);
    scene_destroy(&p.s);
}

static void test_patch_of_a_grasp(void **unused) {
    (void)unused;
    patch_of_a_hold("held and pulled 3 mm", (double[3]){0.1, 0, 0.25}, (double[3]){0, 0, 0.003}, false);
    patch_of_a_hold("held, the shaft pressed", (double[3]){0.15, 0, 0.06}, (double[3]){0.001, 0, -0.004}, true);
}

/* The patch of a moving tool extends ahead of it. */
static void test_patch_leads_the_tool(void **unused) {
    (void)unused;
    patch_scene p = press(0, 0, 0.004, 0.0042, false);
    tm_surface_view surface = tm_tissue_surface(p.s.tissue);
    tm_capsule tool = {.radius_m = 0.0025};
    memcpy(tool.tip_m, p.tip_m, sizeof tool.tip_m);
    double middle[2] = {0, 0};
    for (int k = 0; k < 2; k++) {
        double velocity[3] = {k ? 0.1 : -0.1, 0, 0};
        assert_true(tm_patch_choose(p.s.mesh->rest_m, tm_world_state(p.s.world)->u_m, &surface, &tool, velocity, 0.08,
                                    NULL, 0, 24, 32, &p.patch) > 12);
        for (int32_t i = 0; i < p.patch.vertex_count; i++) middle[k] += p.patch.rest_m[3 * i] / p.patch.vertex_count;
    }
    print_message("middle of the patch at 0.1 m/s: %.1f mm and %.1f mm\n", 1e3 * middle[0], 1e3 * middle[1]);
    assert_true(middle[1] - middle[0] > 0.003);
    assert_true(tm_patch_choose(p.s.mesh->rest_m, tm_world_state(p.s.world)->u_m, &surface, &tool, (double[3]){0}, 0,
                                NULL, 0, 12, 16, &p.patch) <= 16);
    assert_true(p.patch.vertex_count <= 12);
    tool.tip_m[2] += 0.1; /* far away: none */
    assert_int_equal(tm_patch_choose(p.s.mesh->rest_m, tm_world_state(p.s.world)->u_m, &surface, &tool, (double[3]){0},
                                     0, NULL, 0, 24, 32, &p.patch),
                     0);
    scene_destroy(&p.s);
}

/* A tool that touches nothing because it appeared inside, or is outside the body, gets no patch: a controller would
 * press against it. */
static void test_no_patch_for_a_tool_that_touches_nothing(void **unused) {
    (void)unused;
    patch_scene p = press(0, 0.003, 0.004, 0.0042, false);
    make(&p);
    tm_tool_pose at = scene_pose(0.003, 0.004, 0.03);
    tm_contact_set_pose(p.s.contact, 0, &at);
    scene_frame(&p.s, 0, at, 0.02);
    assert_true(tm_contact_reaction(p.s.contact, 0).flags & TM_REACTION_INSIDE);
    for (int k = 0; k < 500 && (k == 0 || tm_patch_pending(p.maker) > 0); k++)
        assert_false(tm_patch_compute(p.maker, 0, &p.patch));
    assert_int_equal(tm_contact_reaction(p.s.contact, 0).stiffness_kind, 0);
    at = scene_pose(0.003, 0.004, 0.044);
    at.active = false;
    scene_frame(&p.s, 0, at, 0.02);
    assert_false(tm_patch_compute(p.maker, 0, &p.patch));
    scene_destroy(&p.s);
}

static void test_computing_a_patch_allocates_nothing(void **unused) {
    (void)unused;
    patch_scene p = press(0, 0.003, 0.004, 0.0042, false);
    int64_t before = tm_memory_in_use();
    make(&p);
    assert_true(tm_memory_in_use() == before);
    tm_patch_def def = tm_patch_def_default();
    tm_error error;
    def.column_vertices = 10;
    assert_int_equal(tm_stage_patch(p.s.world, p.s.contact, &def, &p.maker, &error), TM_ERR_ARGUMENT);
    scene_destroy(&p.s);
    assert_true(tm_memory_in_use() == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_patch_follows_settled_tissue),
        cmocka_unit_test(test_patch_after_a_cut),
        cmocka_unit_test(test_stiffness_on_the_lip_of_a_slit),
        cmocka_unit_test(test_patch_of_a_grasp),
        cmocka_unit_test(test_patch_leads_the_tool),
        cmocka_unit_test(test_no_patch_for_a_tool_that_touches_nothing),
        cmocka_unit_test(test_computing_a_patch_allocates_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
