/* Estimates are labelled: every stiffness that is sent (kind above 0) equals the change of force by moving the tool,
 * in random scenes with every effect, also in the frames while it is computed. */
#include "kit.h"

#include "tensormass/cut.h"

#define FELT_N 0.01
/* Tolerances relative to the change by moving the tool: linear tissue, while the tool moves and at rest; rotated
 * tissue, whose factor omits the geometric stiffness of stress (4 to 15 % at rest under a press). */
#define STRAIGHT_MOVING 0.15
#define STRAIGHT 0.08
#define TURNED 0.3
#define RUBBED 0.45      /* sent without friction */
#define DAMPING_1_S 60.0 /* nearly critical for the slowest mode: tissue of a moved tool then comes to rest soonest */
#define TROCAR_X_M 0.05
#define TROCAR_Y_M 0.02
enum { TERM_S = 1000 }; /* nothing relaxes while the tool is moved: the stiffness is the instantaneous one */

typedef struct sent {
    fix_random random;
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_contact *contact;
    tm_patch_builder *maker;
    tm_compliance_factor *factored;
    bool turns, holds, has_friction, relaxes, cuts;
    int hands;
    double tip_m[3], other_m[3]; /* over the tissue: the first hand's tool, the second hand's probe */
    tm_tool_pose pose[2];
    uint8_t *before;
    int64_t bytes;
} sent;

static bool maybe(sent *s, double share) { return fix_uniform(&s->random) < share; }

static void make_tissue(sent *s) {
    const int cells[3] = {6, 5, 3};
    const double size[3] = {0.07, 0.06, 0.03}, along[3] = {1, 2, 2};
    tm_material material;
    tm_error error;
    if (maybe(s, 0.3))
        fix_ok(tm_material_five(3000, 2000, 4000, 3000, 1000, &material, &error), &error);
    else
        material = kit_material(4000, 0.3 + 0.15 * fix_uniform(&s->random));
    material.damping_1_s = DAMPING_1_S;
    s->mesh = fix_block(cells, size, 0.2, &s->random);
    double *fibre = fix_fibres(s->mesh, along);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = s->mesh, def.material_count = 1, def.material = &material, def.fibre = fibre, def.cuttable = true;
    def.strain_smoothing = maybe(s, 0.5);
    if (s->turns) def.rotation = TM_ROTATION_THRESHOLD, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &s->tissue, &error), &error);
    free(fibre);
}

static void add_stages(sent *s) {
    tm_error error;
    tm_instrument_def tool = {.mode = s->holds ? TM_TOOL_GRASPER : TM_TOOL_PROBE,
                              .radius_m = 0.003,
                              .contact_length_m = 0.1,
                              .trocar_m = {TROCAR_X_M, TROCAR_Y_M, 0.25},
                              .pose = {.active = true}};
    memcpy(tool.pose.tip_m, s->tip_m, sizeof s->tip_m);
    tm_instrument_def tools[2] = {tool, tool};
    tools[1].mode = TM_TOOL_PROBE;
    memcpy(tools[1].pose.tip_m, s->other_m, sizeof s->other_m);
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = s->hands, contact.instrument = tools;
    if (s->turns) fix_ok(tm_stage_rotation(s->world, NULL, &error), &error);
    tm_viscosity_def slow = tm_viscosity_def_default();
    slow.count = 1, slow.term[0] = (tm_viscosity_term){TERM_S, 0.3, 0.3};
    if (s->relaxes) fix_ok(tm_stage_viscosity(s->world, &slow, &error), &error);
    fix_ok(tm_stage_contact(s->world, &contact, &s->contact, &error), &error);
    tm_grasp_def grasp_def = tm_grasp_def_default();
    tm_grasp *grasp;
    fix_ok(tm_stage_grasp(s->world, s->contact, &grasp_def, &grasp, &error), &error);
    tm_friction_def rough = tm_friction_def_default();
    rough.instrument[0] = (tm_friction_coefficient){0.3, 0.2};
    tm_friction *friction;
    if (s->has_friction) fix_ok(tm_stage_friction(s->world, s->contact, &rough, &friction, &error), &error);
}

/* The world of the tissue, and its patch builder. */
static void make_world(sent *s, const uint8_t *fixed, bool exact) {
    tm_error error;
    tm_world_def world = tm_world_def_default();
    world.tissue = s->tissue;
    fix_ok(tm_world_create(&world, &s->world, &error), &error);
    kit_support(s->world, fixed, NULL);
    add_stages(s);
    tm_patch_def patch = tm_patch_def_default();
    tm_compliance_source source;
    if (exact) {
        tm_compliance_factor_def def = tm_compliance_factor_def_default();
        def.tissue = s->tissue, def.fixed = fixed, def.corotated = s->turns;
        fix_ok(tm_compliance_factor_create(&def, &s->factored, &error), &error);
        source = tm_compliance_factor_source(s->factored);
        patch.source = &source;
    }
    fix_ok(tm_stage_patch(s->world, s->contact, &patch, &s->maker, &error), &error);
    for (int h = 0; h < s->hands; h++) s->pose[h] = tm_contact_pose(s->contact, h);
}

static sent make(uint64_t seed, int hands) {
    sent s = {.random = {seed}, .hands = hands};
    s.turns = maybe(&s, 0.6), s.holds = maybe(&s, 0.5), s.has_friction = maybe(&s, 0.3), s.cuts = maybe(&s, 0.5);
    s.relaxes = maybe(&s, 0.3);
    const bool exact = maybe(&s, 0.8);
    memcpy(s.tip_m, (double[3]){0.045 + 0.01 * fix_uniform(&s.random), 0.02 + 0.02 * fix_uniform(&s.random), 0.034},
           sizeof s.tip_m);
    make_tissue(&s);
    uint8_t *fixed = kit_clamp(s.mesh, 1e-9);
    for (int32_t d = 0; d < 3 * s.mesh->vertex_count; d++)
        fixed[d] |= s.mesh->rest_m[d / 3 * 3 + 2] < 1e-9 && s.mesh->rest_m[d / 3 * 3] < 0.03;
    memcpy(s.other_m, (double[3]){s.tip_m[0] - 0.02, s.tip_m[1] + 0.012, s.tip_m[2]}, sizeof s.other_m);
    make_world(&s, fixed, exact || hands > 1);
    free(fixed);
    return s;
}

static void destroy(sent *s) {
    tm_world_destroy(s->world);
    tm_compliance_factor_destroy(s->factored);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
    free(s->before);
}

static void frame(sent *s, const tm_tool_pose to[2], double seconds) {
    const int32_t substeps = (int32_t)ceil(seconds / tm_world_step_s(s->world));
    tm_contact_begin_frame(s->contact, substeps, 1);
    for (int h = 0; h < s->hands; h++) tm_contact_set_target(s->contact, h, &to[h], substeps);
    assert_int_equal(tm_world_step(s->world, substeps), TM_OK);
}

/* Returns the equilibrium force with a hand's tool moved, from the present state, which is restored. 0.17 s leave
 * 0.7 % of the tissue's motion with DAMPING_1_S. With damping far from critical, 13 % were left after 0.27 s, and
 * mistaken for errors of the stiffness. */
static void force_at(sent *s, int hand, int axis, double by_m, double force_N[3]) {
    tm_error error;
    tm_tool_pose to[2] = {s->pose[0], s->pose[1]};
    to[hand].tip_m[axis] += by_m;
    s->bytes = tm_snapshot_bytes(s->world);
    s->before = realloc(s->before, (size_t)s->bytes);
    fix_ok(tm_snapshot_save(s->world, s->before, s->bytes, &error), &error);
    frame(s, to, 0.02);
    frame(s, to, 0.15);
    memcpy(force_N, tm_contact_reaction(s->contact, hand).force_N, 3 * sizeof(double));
    fix_ok(tm_snapshot_restore(s->world, s->before, s->bytes, &error), &error);
}

/* Returns the relative error of the stiffness; -1: next to a second hand the moved tool touches nothing. It is sent
 * without friction, while sticking tissue moves along: there it is compared along the press only, with a wider
 * tolerance. */
static double off_by(sent *s, int hand, const tm_tool_reaction *r) {
    const double step_m = 2e-4;
    double K[9], wrong = 0, size = 0, here[3];
    force_at(s, hand, 0, 0, here);
    double least = fix_largest(here, 3);
    for (int c = 0; c < 3; c++) {
        double there[3];
        force_at(s, hand, c, step_m, there);
        least = fmin(least, fix_largest(there, 3));
        for (int i = 0; i < 3; i++) K[3 * i + c] = (there[i] - here[i]) / step_m;
    }
    for (int i = 0; i < 9; i++) {
        if (s->has_friction && i != 8) continue;
        wrong += pow(K[i] - r->stiffness_N_m[i], 2), size += K[i] * K[i];
    }
    return s->hands == 1 || least > FELT_N ? sqrt(wrong / size) : -1;
}

static void cut_beside(sent *s) {
    for (int tries = 0; tries < 200; tries++) {
        const int32_t t = (int32_t)(fix_uniform(&s->random) * s->mesh->tet_count);
        double x[3] = {0}, d2 = 0;
        for (int i = 0; i < 12; i++) x[i % 3] += 0.25 * s->mesh->rest_m[3 * s->mesh->tet[4 * t + i / 3] + i % 3];
        for (int c = 0; c < 2; c++) d2 += pow(x[c] - s->tip_m[c], 2);
        if (!tm_tissue_alive(s->tissue)[t] || d2 < pow(0.014, 2) || d2 > pow(0.025, 2) || x[2] < 0.012) continue;
        tm_cut_remove(s->tissue, &t, 1, NULL, 0);
        return;
    }
}

/* Presses, or grasps, lifts and rotates; then stays. */
static tm_tool_pose pose_at(const sent *s, int k) {
    tm_tool_pose to = s->pose[0];
    const double down = fmin(k / 10.0, 1), up = s->holds ? fmin(fmax(k - 16, 0) / 12.0, 1) : 0;
    memcpy(to.tip_m, s->tip_m, sizeof s->tip_m);
    to.tip_m[2] += -0.0065 * down + 0.014 * up;
    to.tip_m[0] -= 0.008 * up;
    to.grip = s->holds && k > 11;
    return to;
}

/* The second hand presses near it, later, and moves to and fro. */
static tm_tool_pose other_at(const sent *s, int k) {
    tm_tool_pose to = s->pose[1];
    memcpy(to.tip_m, s->other_m, sizeof s->other_m);
    to.tip_m[2] -= 0.0065 * fmin(fmax(k - 6, 0) / 8.0, 1);
    to.tip_m[0] += 0.003 * sin(0.2 * k);
    return to;
}

typedef struct tally {
    int sent, felt, compared, scenes;
    double worst[2][3]; /* [friction][kind] */
} tally;

/* Checks the sample of frame `k`; `compare`: against moving its tool. */
static void see(sent *s, int hand, int k, bool compare, tally *t) {
    tm_patch patch;
    const bool made = tm_patch_compute(s->maker, hand, &patch);
    const tm_tool_reaction r = tm_contact_reaction(s->contact, hand);
    assert_true(!made || r.stiffness_kind == patch.kind);
    const bool felt = fabs(r.force_N[0]) + fabs(r.force_N[1]) + fabs(r.force_N[2]) > FELT_N;
    t->felt += felt && s->factored, t->sent += felt && s->factored && made;
    if (r.stiffness_kind == 0 || !compare || !felt) return;
    const double off = off_by(s, hand, &r);
    const double straight = k > (s->holds ? 32 : 14) && s->hands == 1 ? STRAIGHT : STRAIGHT_MOVING;
    if (off > (s->has_friction ? RUBBED : s->turns ? TURNED : straight))
        fail_msg("hand %d, frame %d, kind %d: the stiffness is %.0f %% off", hand, k, r.stiffness_kind, 100 * off);
    t->worst[s->has_friction][r.stiffness_kind] = fmax(t->worst[s->has_friction][r.stiffness_kind], off);
    t->compared += off >= 0;
}

static void follow(uint64_t seed, int hands, bool each_frame, tally *t) {
    sent s = make(seed, hands);
    for (int k = 0; k < 40; k++) {
        if (s.cuts && k > 20 && k % 4 == 0) cut_beside(&s);
        s.pose[0] = pose_at(&s, k);
        if (hands > 1) s.pose[1] = other_at(&s, k);
        frame(&s, s.pose, 0.04);
        const bool each = each_frame && (k < 14 || k % 4 == 0 || test_is_long());
        for (int h = 0; h < hands; h++) see(&s, h, k, each || k % 9 == 3 || k == 2, t);
    }
    t->scenes++;
    destroy(&s);
}

static void sent_stiffness_is_the_change_of_force(void **state) {
    (void)state;
    tally t = {0};
    const uint64_t seeds = test_is_long() ? 200 : test_is_sanitized() ? 1 : 6;
    for (uint64_t seed = 1; seed <= seeds; seed++) follow(seed, 1, false, &t);
    print_message(
        "  %d scenes, %d of %d samples on tissue carry a patch; worst: estimated %.2f, exact %.2f; with friction "
        "%.2f, %.2f\n",
        t.scenes, t.sent, t.felt, t.worst[0][1], t.worst[0][2], t.worst[1][1], t.worst[1][2]);
    assert_true(t.felt > 20 * (int)seeds && t.sent >= 0.99 * t.felt);
}

/* Every frame, not a few: pressed and cut, lifted, and two hands at once. */
static void sent_stiffness_is_correct_in_every_frame(void **state) {
    (void)state;
    const struct {
        uint64_t seed;
        int hands;
    } scene[] = {{11, 1}, {3, 1}, {4, 2}, {8, 1}, {7, 1}, {13, 1}};
    for (int k = 0; k < (test_is_sanitized() ? 1 : test_is_long() ? 6 : 3); k++) {
        tally t = {0};
        follow(scene[k].seed, scene[k].hands, true, &t);
        print_message("  %d hands: %d samples compared, worst %.2f\n", scene[k].hands, t.compared,
                      fmax(t.worst[0][1], t.worst[0][2]));
        assert_true(t.compared > 16 * scene[k].hands && t.sent >= 0.99 * t.felt);
    }
}

/* --- tissue that rotates far between two factors --- */
static void make_bar(sent *s) {
    const int cells[3] = {6, 4, 4};
    const double size[3] = {0.045, 0.03, 0.03};
    tm_material material = kit_material(4000, 0.4);
    tm_error error;
    material.damping_1_s = DAMPING_1_S;
    s->mesh = fix_block(cells, size, 0.2, &s->random);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = s->mesh, def.material_count = 1, def.material = &material;
    def.rotation = TM_ROTATION_THRESHOLD, def.smoothed_shear_share = 0;
    fix_ok(tm_tissue_create(&def, &s->tissue, &error), &error);
}

/* Rotates support and tool about the vertical through the trocar. */
static void turn_by(sent *s, const uint8_t *fixed, double angle) {
    const double co = cos(angle), si = sin(angle), *tip = s->tip_m;
    int32_t component = 0;
    for (int32_t d = 0; d < 3 * s->mesh->vertex_count; d++) {
        const double *rest = s->mesh->rest_m + d / 3 * 3, x = rest[0] - TROCAR_X_M, y = rest[1] - TROCAR_Y_M;
        const double by[3] = {co * x - si * y - x, si * x + co * y - y, 0};
        if (fixed[d]) tm_support_move(s->world, component++, by[d % 3]);
    }
    const double x = tip[0] - TROCAR_X_M, y = tip[1] - TROCAR_Y_M;
    s->pose[0].tip_m[0] = TROCAR_X_M + co * x - si * y, s->pose[0].tip_m[1] = TROCAR_Y_M + si * x + co * y;
    s->pose[0].roll_rad = -angle; /* about the shaft, which points down */
}

static double sent_off_by(sent *s) {
    tm_patch patch;
    assert_true(tm_patch_compute(s->maker, 0, &patch));
    const tm_tool_reaction r = tm_contact_reaction(s->contact, 0);
    return off_by(s, 0, &r);
}

/* Tissue, supports and tool are rotated together by 43 degrees: the stiffness is correct with the previous factor,
 * which rotates with the tissue, and with a new one. */
static void sent_stiffness_rotates_between_factors(void **state) {
    (void)state;
    const double turned = 0.75;
    for (int holds = 0; holds < 2; holds++) {
        sent s = {.random = {3}, .hands = 1, .turns = true, .holds = holds, .tip_m = {0.036, 0.014, 0.034}};
        tm_patch patch;
        make_bar(&s);
        uint8_t *fixed = kit_clamp(s.mesh, 1e-9);
        make_world(&s, fixed, true);
        s.pose[0].tip_m[2] = 0.0275;
        frame(&s, s.pose, 0.4);
        s.pose[0].grip = holds;
        frame(&s, s.pose, 0.4);
        const double before = sent_off_by(&s);
        for (int k = 1; k <= 40; k++) { /* no compliance is requested meanwhile: no new factor */
            turn_by(&s, fixed, turned * k / 40);
            frame(&s, s.pose, 0.02);
        }
        frame(&s, s.pose, 0.5);
        const double kept = sent_off_by(&s);
        for (int k = 0; k < 30; k++) assert_true(tm_patch_compute(s.maker, 0, &patch));
        const double anew = sent_off_by(&s);
        print_message("  %s: %.3f off before, %.3f turned, %.3f by a new factor\n", holds ? "held" : "pressed", before,
                      kept, anew);
        assert_true(before < 0.06 && kept < 0.06 && anew < 0.06);
        free(fixed);
        destroy(&s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(sent_stiffness_is_the_change_of_force),
                                       cmocka_unit_test(sent_stiffness_is_correct_in_every_frame),
                                       cmocka_unit_test(sent_stiffness_rotates_between_factors)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
