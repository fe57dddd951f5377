/* Energy in every window of random sessions of two hands with every effect. From any instant, for 1 to 200 ms, tissue
 * and springs gain no more than hands, loads and supports supply, except for 1.2 % (1.5 with rotation) of the most
 * stored meanwhile. The aim is 0.1 %; docs/passivity.md says why it is missed.
 *
 * The reference is not the energy at the window's ends: energy rightly gained while tissue was pressed stays when it no
 * longer is. The account of a session (test_sessions.c) does not show energy that contact generates while hands are at
 * rest: that is less than all their earlier work. A session that exceeds the bound is shrunk to the fewest actions and
 * effects that still do, and printed.
 *
 * Only contact, jaws and their springs are tested, less the damping losses; the tissue's law and viscosity:
 * test_loops.c, test_viscosity.c.
 *
 * Choice of sessions: random_session.h. TM_LONG=1 draws some with a Poisson's ratio of 0.499 and 0.4999. */
#include "contact_scene.h"

enum { MAX_ACTIONS = 10, SAMPLES_A_FRAME = 5, MAX_SAMPLES = 400, FRAMES_AFTER = 60 };
static const double SAMPLE_S = 1e-3, WINDOW_S = 0.2;
/* Hands of random sessions stand still or are faster than what counts as slow (contact_passivity.c), where a tool may
 * be given up to half of its reaction times its way, out of what contact took before and a credit. */
static const double SLOW_M_S = 0.05, FAST_M_S = 0.06, SLIDING_SHARE = 0.5;
/* What a window may gain: a share of what is stored, and rounding. With rotation what is stored under a tool is
 * estimated and not checked (contact_passivity.c). */
static const double SHARE = 1.2e-2, TURNING_SHARE = 1.5e-2, ROUNDING_J = 1e-7;

enum { ROTATION = 1, VOLUME = 2, VISCOSITY = 4, FRICTION = 8, GRASP = 16, CUT = 32, EFFECTS = 6 };
static const char *const EFFECT[EFFECTS] = {"rotation", "volume", "viscosity", "friction", "grasp", "cut"};

typedef enum kind { PRESS, SQUEEZE, RELEASE, PULL, DRAG, CLOSE, OPEN, BURN, LEAVE, STAND, KINDS } kind;
static const char *const KIND[KINDS] = {"press", "squeeze", "release", "pull",  "drag",
                                        "close", "open",    "burn",    "leave", "stand"};

typedef struct action {
    kind what;
    int tool, frames;
    double to_m[3], by_m, roll_rad;
} action;

typedef struct session {
    uint64_t seed;
    int effects;
    tm_tool_mode mode[2];
    int cells[3];
    double edge_m, jitter, young_Pa, poisson, damping_1_s, shear, fade_s, radius_m, rub[2], relaxes, relaxes_s;
    bool slow;
    int count;
    action action[MAX_ACTIONS];
} session;

typedef struct sample {
    double generated_J; /* by contact and jaws, less what they lost, what hands put in and what damping took */
    double stored_J;    /* in tissue and springs */
    double sliding_J;   /* that hands may be given which slide slowly, in all */
} sample;

typedef struct verdict {
    bool good;
    int action;               /* during which it failed */
    double worst;             /* gain over what it may be */
    double hands_J, stored_J; /* put in and out; the most that was stored */
    char why[160];
} verdict;

#include "random_session.h"

/* --- making --- */

static double height_of(const session *s) { return s->cells[2] * s->edge_m; }

static session random_session(uint64_t seed) {
    session s = {.seed = seed};
    begin_drawing(seed);
    for (int i = 0; i < EFFECTS; i++) s.effects |= (scene_random() < 0.5) << i;
    for (int t = 0; t < 2; t++) s.mode[t] = draw_mode(0.6, 0.3);
    s.cells[0] = whole(4, 7), s.cells[1] = whole(4, 7), s.cells[2] = whole(2, 4);
    s.edge_m = between(0.006, 0.01), s.jitter = between(0, 0.25);
    s.young_Pa = 2000 * pow(10, scene_random());
    s.poisson = between(0.2, 0.49);
    if (test_is_long() && scene_random() < 0.1) s.poisson = scene_random() < 0.5 ? 0.499 : 0.4999;
    s.damping_1_s = pow(10, between(0, 2));
    s.shear = scene_random();
    s.fade_s = draw_fade_s();
    s.radius_m = between(0.002, 0.004);
    s.rub[1] = between(0.05, 0.5), s.rub[0] = s.rub[1] * between(1, 1.5);
    s.relaxes = between(0.1, 0.8), s.relaxes_s = pow(10, between(-2, 0));
    s.count = whole(4, MAX_ACTIONS);
    for (int i = 0; i < s.count; i++) {
        action *a = s.action + i;
        a->what = (kind)(KINDS * scene_random());
        a->tool = scene_random() < 0.5;
        a->frames = whole(4, 16);
        a->to_m[0] = between(-0.35, 0.35) * s.cells[0] * s.edge_m;
        a->to_m[1] = between(-0.35, 0.35) * s.cells[1] * s.edge_m;
        a->to_m[2] = between(-0.4, -0.02) * height_of(&s);
        a->by_m = between(0.002, 0.025);
        a->roll_rad = between(-0.5, 0.5);
    }
    return s;
}

static void print_session(const session *s) {
    static const char *const mode[] = {"probe", "grasper", "cautery"};
    print_message("  seed %llu: %s and %s,", (unsigned long long)s->seed, mode[s->mode[0]], mode[s->mode[1]]);
    for (int i = 0; i < EFFECTS; i++)
        if (s->effects >> i & 1) print_message(" %s,", EFFECT[i]);
    print_message(" %d x %d x %d cells of %.4f m, jitter %.3f, radius %.4f m, E %.0f Pa, nu %.4f, damping %.2f 1/s, "
                  "shear %.2f, fade %.0f ms, friction %.2f %.2f, relaxes %.2f in %.3f s\n",
                  s->cells[0], s->cells[1], s->cells[2], s->edge_m, s->jitter, s->radius_m, s->young_Pa, s->poisson,
                  s->damping_1_s, s->shear, 1e3 * s->fade_s, s->rub[0], s->rub[1], s->relaxes, s->relaxes_s);
    for (int i = 0; i < s->count; i++) {
        const action *a = s->action + i;
        print_message("    tool %d: %-8s to (%.2f, %.2f, %.2f) mm, by %.2f mm, roll %.2f, in %d frames\n", a->tool,
                      KIND[a->what], 1e3 * a->to_m[0], 1e3 * a->to_m[1], 1e3 * a->to_m[2], 1e3 * a->by_m, a->roll_rad,
                      a->frames);
    }
}

/* --- running --- */

typedef struct stage {
    scene s;
    tm_tool_pose at[2];
    int32_t substeps; /* a sample: a whole number of steps, so not always SAMPLE_S */
    double sample_s, share;
    int window; /* samples in WINDOW_S */
    double top_m;
    int64_t seen;
    sample ring[MAX_SAMPLES + 1];
    double tool_work_J, sliding_J;
    verdict v;
    bool tell;
} stage;

static void open_tissue(stage *g, const session *s) {
    tm_error error;
    scene *to = &g->s;
    to->mesh = scene_mesh(&to->def);
    scene_must(tm_material_young(s->young_Pa, s->poisson, &to->material, &error), &error);
    to->material.damping_1_s = s->damping_1_s;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = to->mesh, def.material_count = 1, def.material = &to->material, def.cuttable = s->effects & CUT;
    def.rotation = s->effects & ROTATION ? TM_ROTATION_THRESHOLD : 0;
    def.strain_smoothing = s->effects & VOLUME, def.smoothed_shear_share = s->effects & ROTATION ? 0 : s->shear;
    scene_must(tm_tissue_create(&def, &to->tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = to->tissue;
    scene_must(tm_world_create(&world, &to->world, &error), &error);
    scene_support(to);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 1, viscosity.term[0] = (tm_viscosity_term){s->relaxes_s, s->relaxes, 0};
    if (s->effects & ROTATION) scene_must(tm_stage_rotation(to->world, NULL, &error), &error);
    if (s->effects & VISCOSITY) scene_must(tm_stage_viscosity(to->world, &viscosity, &error), &error);
}

static void open_tools(stage *g, const session *s) {
    static const double trocar[2][3] = {{0.1, 0, 0.15}, {-0.1, 0.02, 0.15}};
    tm_instrument_def tool[2];
    tm_error error;
    for (int t = 0; t < 2; t++) {
        g->at[t] = scene_pose(t ? -0.012 : 0.012, 0, g->top_m + 0.01);
        g->at[t].active = s->mode[t] != TM_TOOL_CAUTERY;
        tool[t] =
            (tm_instrument_def){.mode = s->mode[t], .radius_m = s->radius_m, .contact_length_m = 0.1, .pose = g->at[t]};
        memcpy(tool[t].trocar_m, trocar[t], sizeof trocar[t]);
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 2, contact.instrument = tool;
    scene_must(tm_stage_contact(g->s.world, &contact, &g->s.contact, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    grasp.release_time_s = s->fade_s;
    tm_cut_def cut = tm_cut_def_default();
    cut.loose = TM_LOOSE_REMOVE;
    tm_friction_def friction = tm_friction_def_default();
    for (int t = 0; t < 2; t++) friction.instrument[t] = (tm_friction_coefficient){s->rub[0], s->rub[1]};
    if (s->effects & GRASP)
        scene_must(tm_stage_grasp(g->s.world, g->s.contact, &grasp, &(tm_grasp *){NULL}, &error), &error);
    if (s->effects & CUT) scene_must(tm_stage_cut(g->s.world, g->s.contact, &cut, &error), &error);
    if (s->effects & FRICTION)
        scene_must(tm_stage_friction(g->s.world, g->s.contact, &friction, &(tm_friction *){NULL}, &error), &error);
}

static stage open_stage(const session *s) {
    stage g = {.s.def = scene_def_default(),
               .v = {.good = true},
               .top_m = height_of(s),
               .share = s->effects & ROTATION ? TURNING_SHARE : SHARE};
    for (int c = 0; c < 3; c++) g.s.def.cells[c] = s->cells[c], g.s.def.size_m[c] = s->cells[c] * s->edge_m;
    g.s.def.jitter = s->jitter;
    open_tissue(&g, s);
    open_tools(&g, s);
    tm_error error;
    scene_must(tm_stage_energy(g.s.world, &error), &error);
    g.substeps = (int32_t)fmax(1, round(SAMPLE_S / tm_world_step_s(g.s.world)));
    g.sample_s = g.substeps * tm_world_step_s(g.s.world);
    g.window = (int)fmin(floor(WINDOW_S / g.sample_s + 1e-6), MAX_SAMPLES);
    return g;
}

/* Of the windows that end now: the largest gain over what it may be. */
static double worst_window(const stage *g, double *gain_J, int *length) {
    const sample *now = g->ring + g->seen % (MAX_SAMPLES + 1);
    double worst = 0, most_J = now->stored_J;
    for (int k = 1; k <= g->window && k <= g->seen; k++) {
        const sample *then = g->ring + (g->seen - k) % (MAX_SAMPLES + 1);
        const double gain = now->generated_J - then->generated_J - (now->sliding_J - then->sliding_J);
        most_J = fmax(most_J, then->stored_J);
        const double ratio = gain / (g->share * most_J + ROUNDING_J);
        if (ratio > worst) worst = ratio, *gain_J = gain, *length = k;
    }
    return worst;
}

static void watch(stage *g, int i) {
    tm_energy e;
    assert_int_equal(tm_world_energy(g->s.world, &e, NULL), TM_OK);
    const double stored = e.kinetic_J + e.elastic_J + e.contact_stored_J, hand = e.tool_work_J[0] + e.tool_work_J[1];
    double gain = 0;
    int length = 0;
    g->ring[g->seen % (MAX_SAMPLES + 1)] =
        (sample){e.generated_J - e.drag_J - e.friction_J - e.damping_J, stored, g->sliding_J};
    const double worst = worst_window(g, &gain, &length);
    g->seen++;
    g->v.hands_J += fabs(hand - g->tool_work_J), g->tool_work_J = hand;
    g->v.stored_J = fmax(g->v.stored_J, stored);
    g->v.worst = fmax(g->v.worst, worst);
    if (g->tell)
        print_message("  %2d: %.4f s stored %.3e J, springs %.1e, hands %+.3e, contact %+.3e %+.3e, grasp %+.3e %+.3e, "
                      "film %.2e, friction %.2e, damping %.2e, gain %+.2e in %d ms\n",
                      i, e.time_s, stored, e.contact_stored_J, hand, e.contact_J[0], e.contact_J[1], e.grasp_J[0],
                      e.grasp_J[1], e.drag_J, e.friction_J, e.damping_J, gain, length);
    if (worst <= 1 || !g->v.good) return;
    g->v.good = false, g->v.action = i;
    snprintf(g->v.why, sizeof g->v.why, "%.2e J out of nothing in %d ms beside %.2e J", gain, length, stored);
}

static double farthest(const tm_tool_pose *a, const tm_tool_pose *b) {
    double sum = 0;
    for (int c = 0; c < 3; c++) sum += (a->tip_m[c] - b->tip_m[c]) * (a->tip_m[c] - b->tip_m[c]);
    return sqrt(sum);
}

/* One sample; each tool goes on to g->at. */
static bool one_sample(stage *g, const double way_m[2]) {
    const tm_contact_row *row;
    tm_contact_begin_frame(g->s.contact, g->substeps, g->substeps);
    for (int t = 0; t < 2; t++) tm_contact_set_target(g->s.contact, t, g->at + t, g->substeps);
    if (tm_world_step(g->s.world, g->substeps) != TM_OK) return false;
    for (int32_t i = tm_contact_rows(g->s.contact, &row) - 1; i >= 0; i--)
        if (way_m[row[i].instrument] < SLOW_M_S * g->sample_s)
            g->sliding_J += SLIDING_SHARE * row[i].lambda_N * way_m[row[i].instrument];
    return true;
}

/* Both tools go to `to` in `frames`, or faster. */
static void go(stage *g, int i, const tm_tool_pose to[2], int frames, bool slow) {
    const tm_tool_pose from[2] = {g->at[0], g->at[1]};
    const double whole_m[2] = {farthest(from, to), farthest(from + 1, to + 1)};
    int samples = frames * SAMPLES_A_FRAME;
    for (int t = 0; t < 2; t++)
        if (whole_m[t] > 0 && !slow)
            samples = (int)fmax(1, fmin(samples, floor(whole_m[t] / (FAST_M_S * g->sample_s))));
    const double way_m[2] = {whole_m[0] / samples, whole_m[1] / samples};
    for (int k = 1; k <= samples && g->v.good; k++) {
        for (int t = 0; t < 2; t++) g->at[t] = on_the_way(from + t, to + t, k, samples);
        if (!one_sample(g, way_m)) {
            snprintf(g->v.why, sizeof g->v.why, "the step is unstable");
            g->v.good = false, g->v.action = i, g->v.worst = INFINITY;
            return;
        }
        watch(g, i);
    }
}

static void act(stage *g, const session *s, int i) {
    const action *a = s->action + i;
    tm_tool_pose to[2] = {g->at[0], g->at[1]}, *mine = to + a->tool;
    double place[3] = {a->to_m[0], a->to_m[1], g->top_m + a->to_m[2]};
    switch (a->what) {
    case PRESS: memcpy(mine->tip_m, place, sizeof place); break;
    case SQUEEZE: /* from both sides towards one place */
        for (int t = 0; t < 2; t++) {
            memcpy(to[t].tip_m, place, sizeof place);
            to[t].tip_m[0] += (t ? -0.5 : 0.5) * a->by_m;
        }
        break;
    case RELEASE:
        for (int t = 0; t < 2; t++) to[t].tip_m[0] += t ? -a->by_m : a->by_m, to[t].grip = 0;
        break;
    case PULL: mine->tip_m[2] += a->by_m, mine->roll_rad = a->roll_rad; break;
    case DRAG:
        for (int t = 0; t < 2; t++)
            to[t].tip_m[0] += a->to_m[0], to[t].tip_m[1] += a->to_m[1], to[t].tip_m[2] += a->by_m;
        break;
    case CLOSE: mine->grip = 1; break;
    case OPEN: mine->grip = 0; break;
    case BURN: mine->active = s->mode[a->tool] != TM_TOOL_CAUTERY || !g->at[a->tool].active; break;
    case LEAVE: mine->tip_m[2] = g->top_m + 0.03; break;
    case STAND:
    case KINDS: break;
    }
    go(g, i, to, a->frames, s->slow);
}

static verdict run_session(const session *s, bool tell) {
    stage g = open_stage(s);
    g.tell = tell;
    for (int i = 0; i < s->count && g.v.good; i++) {
        if (tell) print_message(" %s\n", KIND[s->action[i].what]);
        act(&g, s, i);
    }
    const tm_tool_pose stay[2] = {g.at[0], g.at[1]};
    go(&g, s->count, stay, FRAMES_AFTER, false);
    scene_destroy(&g.s);
    return g.v;
}

static bool drop_effect(session *s, int i) {
    const int before = s->effects;
    s->effects &= ~(1 << i);
    return s->effects != before;
}

/* --- the tests --- */

/* Seeds that broke the bound while it was being made to hold: jaws that let go (at once: 1368), springs at their knee,
 * two tools on the same tissue, jaws that pull against another tool, tissue that is let go of (433); springs at their
 * cap while contact is held back (103092, 104021), that slip to and fro (202195), that close in motion (202960); two
 * tools whose turns do not meet (103932, 201933); what is stored estimated too high (103631, 201976). */
static const uint64_t ONCE_BROKE[] = {2,      433,    1310,   1350,   1368,   1388,   1400,   1452,
                                      103092, 103631, 103932, 104021, 201933, 201976, 202195, 202960};

typedef struct tally {
    double worst, hands_J, stored_J;
} tally;

static void take(void *to, uint64_t seed, const verdict *v) {
    tally *sum = to;
    (void)seed;
    sum->worst = fmax(sum->worst, v->worst), sum->hands_J += v->hands_J,
    sum->stored_J = fmax(sum->stored_J, v->stored_J);
}

static void test_random_sessions(void **unused) {
    (void)unused;
    const session_range range =
        sessions_to_run(test_is_sanitized() ? 10 : 100, ONCE_BROKE, sizeof ONCE_BROKE / sizeof *ONCE_BROKE);
    tally sum = {0};
    const int failed = run_sessions(&range, take, &sum);
    print_message("%llu sessions: %.2f J through the hands, at most %.3f J stored, gain at most %.2f of its bound\n",
                  (unsigned long long)(range.count + range.again), sum.hands_J, sum.stored_J, sum.worst);
    assert_true(range.count < 10 || sum.hands_J > 0.01 * (double)range.count);
    assert_int_equal(failed, 0);
}

static verdict run_actions(session s, int count, const action *actions) {
    s.count = count;
    memcpy(s.action, actions, sizeof *actions * (size_t)count);
    const verdict v = run_session(&s, false);
    print_message("hands %.2e J, stored %.2e J, gain %.2f of its bound %s\n", v.hands_J, v.stored_J, v.worst, v.why);
    return v;
}

static const session PLAIN = {.mode = {TM_TOOL_GRASPER, TM_TOOL_GRASPER},
                              .cells = {6, 6, 3},
                              .edge_m = 0.008,
                              .jitter = 0.2,
                              .young_Pa = 4400,
                              .poisson = 0.37,
                              .damping_1_s = 1.1,
                              .radius_m = 0.003};

/* Rotation alone, four actions: squeezed and let go of, pulled, pulled, squeezed and let go of. */
static void test_smallest_that_was_found(void **unused) {
    (void)unused;
    const action pull[2] = {{PULL, 0, 8, {0}, 0.012, 0}, {PULL, 1, 8, {0}, 0.012, 0}},
                 squeeze = {SQUEEZE, 0, 12, {0.002, 0.003, -0.008}, 0.006, 0}, release = {RELEASE, 0, 8, {0}, 0.01, 0};
    const action all[] = {squeeze, release, pull[0], pull[1], squeeze, release};
    session s = PLAIN;
    s.effects = ROTATION;
    assert_true(run_actions(s, 6, all).good);
}

/* Squeezed deep from both sides, drawn far above the block and held there: broke the bound as it was drawn. */
static void test_drawn_up_and_held(void **unused) {
    (void)unused;
    const action stand = {STAND, 0, 50, {0}, 0, 0};
    const action all[] = {
        {SQUEEZE, 0, 12, {0, 0, -0.014}, 0.007, 0}, {DRAG, 0, 16, {0}, 0.045, 0}, stand, stand, stand};
    session s = PLAIN;
    s.effects = VOLUME | FRICTION, s.shear = 0.4, s.rub[0] = 0.5, s.rub[1] = 0.4;
    assert_true(run_actions(s, 5, all).good);
}

/* A hand that slides slowly feels the force of rest (test_contact.c): what that gives is bounded too. */
static void test_slow_slide(void **unused) {
    (void)unused;
    const action all[] = {{PRESS, 0, 40, {-0.01, 0.002, -0.004}, 0, 0},
                          {PRESS, 0, 160, {-0.004, 0.004, -0.004}, 0, 0},
                          {STAND, 0, 40, {0}, 0, 0},
                          {PRESS, 0, 160, {0.002, 0.006, -0.004}, 0, 0},
                          {STAND, 0, 40, {0}, 0, 0}};
    session s = PLAIN;
    s.slow = true, s.damping_1_s = 60;
    assert_true(run_actions(s, 5, all).good);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_smallest_that_was_found),
        cmocka_unit_test(test_drawn_up_and_held),
        cmocka_unit_test(test_slow_slide),
        cmocka_unit_test(test_random_sessions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
