/* Random sessions of two hands: press, grasp, cross, pinch, cut, hand over, release. Tissue gains no more energy
 * than the hands supply and moves no farther than they can move it, and contact comes to rest. A session that
 * exceeds a bound is shrunk to the fewest actions that still do, and printed.
 *
 * Choice of sessions: random_session.h. */
#include "contact_scene.h"

enum { MAX_ACTIONS = 14, FRAMES_AFTER = 30, EFFECTS = 0 };
static const double FRAME_S = 0.005, TOP_M = 0.03, HALF_M = 0.024;
/* Maximum energy of tissue and springs beyond the hands' work: a share of all that hands gave and received, and an
 * amount too small for a bound. The worst of 100 sessions has 0.049, of 300 more 0.076 (seed 100048). The bound is
 * above: contact that generates twice as much is found; other rounding on another processor, which changes a session
 * completely, is not. */
static const double SURPLUS_SHARE = 0.12, SURPLUS_J = 5e-5;
static const double FARTHEST_M = 0.1; /* maximum displacement of any vertex: the hands themselves move 0.08 */

typedef enum kind { PRESS, LIFT, CLOSE, OPEN, CROSS, PINCH, CUT, HAND_OVER, PULL, WAIT, KINDS } kind;
static const char *const KIND[KINDS] = {"press", "lift", "close",     "open", "cross",
                                        "pinch", "cut",  "hand over", "pull", "wait"};

typedef struct action {
    kind what;
    int tool, frames;
    double to_m[3], roll_rad;
} action;

typedef struct session {
    uint64_t seed;
    tm_tool_mode mode[2];
    double young_Pa, damping_1_s, fade_s;
    int count;
    action action[MAX_ACTIONS];
} session;

typedef struct verdict {
    bool good;
    int action; /* action during which it failed */
    char why[200];
    double hands_J, worst; /* the worst surplus, as a share of its bound */
    double farthest_m;
} verdict;

#include "random_session.h"

/* --- making --- */

static session random_session(uint64_t seed) {
    session s = {.seed = seed};
    begin_drawing(seed);
    for (int t = 0; t < 2; t++) s.mode[t] = draw_mode(0.6, 0.25);
    s.young_Pa = between(2000, 20000);
    s.damping_1_s = between(10, 150);
    s.fade_s = draw_fade_s();
    s.count = 6 + (int)(8 * scene_random());
    for (int i = 0; i < s.count; i++) {
        action *a = s.action + i;
        a->what = (kind)(KINDS * scene_random());
        a->tool = scene_random() < 0.5;
        a->frames = 4 + (int)(12 * scene_random());
        a->to_m[0] = between(-0.018, 0.018);
        a->to_m[1] = between(-0.012, 0.012);
        a->to_m[2] = TOP_M + between(-0.008, 0.004);
        a->roll_rad = between(-0.5, 0.5);
    }
    return s;
}

static void print_session(const session *s) {
    static const char *const mode[] = {"probe", "grasper", "cautery"};
    print_message("  seed %llu: %s and %s, E %.0f Pa, damping %.0f 1/s, fade %.0f ms\n", (unsigned long long)s->seed,
                  mode[s->mode[0]], mode[s->mode[1]], s->young_Pa, s->damping_1_s, 1e3 * s->fade_s);
    for (int i = 0; i < s->count; i++) {
        const action *a = s->action + i;
        print_message("    tool %d: %-9s to (%.1f, %.1f, %.1f) mm, roll %.2f, in %.0f ms\n", a->tool, KIND[a->what],
                      1e3 * a->to_m[0], 1e3 * a->to_m[1], 1e3 * a->to_m[2], a->roll_rad, 1e3 * FRAME_S * a->frames);
    }
}

/* --- running --- */

typedef struct stage {
    scene s;
    tm_tool_pose at[2];
    double tool_work_J[2]; /* as last received */
    int32_t substeps;
    verdict v;
    bool tell;
} stage;

static stage open_stage(const session *s) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 6, d.cells[2] = 3;
    d.size_m[0] = d.size_m[1] = 2 * HALF_M, d.size_m[2] = TOP_M;
    d.young_Pa = s->young_Pa, d.damping_1_s = s->damping_1_s, d.tools = 2;
    memcpy(d.trocar_m, (double[2][3]){{0.1, 0, 0.15}, {-0.1, 0.02, 0.15}}, sizeof d.trocar_m);
    memcpy(d.tip_m, (double[2][3]){{0.012, 0, TOP_M + 0.01}, {-0.012, 0, TOP_M + 0.01}}, sizeof d.tip_m);
    stage g = {.s = scene_create_full(&d, true, s->mode), .v = {.good = true}};
    for (int t = 0; t < 2; t++) {
        g.at[t] = scene_pose(d.tip_m[t][0], d.tip_m[t][1], d.tip_m[t][2]);
        g.at[t].active = s->mode[t] != TM_TOOL_CAUTERY;
    }
    tm_error error;
    tm_grasp *grasp;
    tm_grasp_def how = tm_grasp_def_default();
    how.release_time_s = s->fade_s;
    tm_cut_def cut = tm_cut_def_default();
    cut.loose = TM_LOOSE_REMOVE;
    scene_must(tm_stage_grasp(g.s.world, g.s.contact, &how, &grasp, &error), &error);
    scene_must(tm_stage_cut(g.s.world, g.s.contact, &cut, &error), &error);
    scene_must(tm_stage_energy(g.s.world, &error), &error);
    g.substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(g.s.world));
    return g;
}

static void fail_at(stage *g, int i, const char *why, double is, double bound) {
    if (g->v.good) snprintf(g->v.why, sizeof g->v.why, "%s %.3g, bound %.3g", why, is, bound);
    if (g->v.good) g->v.action = i;
    g->v.good = false;
}

static void judge(stage *g, int i, bool after) {
    tm_energy e;
    assert_int_equal(tm_world_energy(g->s.world, &e, NULL), TM_OK);
    double throughput = e.start_J + fabs(e.support_J) + e.damping_J + fabs(e.cut_J) + fabs(e.state_change_J);
    for (int t = 0; t < 2; t++) {
        g->v.hands_J += fabs(e.tool_work_J[t] - g->tool_work_J[t]);
        g->tool_work_J[t] = e.tool_work_J[t];
        throughput += fabs(e.contact_J[t]) + fabs(e.grasp_J[t]);
        const bool overflowed = tm_contact_reaction(g->s.contact, t).flags & TM_REACTION_OVERFLOWED;
        if (after && overflowed) fail_at(g, i, "tools are out and contact is still overflowed, tool", t, 0);
    }
    const double may = SURPLUS_SHARE * g->v.hands_J + SURPLUS_J;
    const double generated = e.generated_J - e.drag_J; /* energy of tissue and springs less the hands' work */
    g->v.worst = fmax(g->v.worst, generated / may);
    const double *u = tm_world_state(g->s.world)->u_m;
    double far = 0;
    for (int32_t k = 0; k < 3 * g->s.mesh->vertex_count; k++)
        if (tm_tissue_mass_kg(g->s.tissue)[k / 3] > 0) far = fmax(far, fabs(u[k]));
    g->v.farthest_m = fmax(g->v.farthest_m, far);
    if (g->tell)
        print_message(
            "  %2d: stored %.2e + %.2e J, hands %+.2e %+.2e, surplus %+.2e of %.1e, held %.1e, film %.1e, cut "
            "%.1e, %.1f mm, %d rows\n",
            i, e.kinetic_J, e.elastic_J, e.tool_work_J[0], e.tool_work_J[1], generated, may, e.contact_stored_J,
            e.drag_J, e.cut_J, 1e3 * far,
            tm_contact_reaction(g->s.contact, 0).row_count + tm_contact_reaction(g->s.contact, 1).row_count);
    if (!(generated <= may)) fail_at(g, i, "more than the hands put in, by J", generated, may);
    if (!(far <= FARTHEST_M)) fail_at(g, i, "a vertex went to m", far, FARTHEST_M);
    if (!(fabs(e.residual_J) <= 1e-9 * throughput + 1e-15))
        fail_at(g, i, "the account does not close, J", e.residual_J, 1e-9 * throughput);
}

/* Both tools move to `to` in `frames`. */
static void go(stage *g, int i, const tm_tool_pose to[2], int frames) {
    const tm_tool_pose from[2] = {g->at[0], g->at[1]};
    for (int k = 1; k <= frames && g->v.good; k++) {
        tm_contact_begin_frame(g->s.contact, g->substeps, g->substeps);
        for (int t = 0; t < 2; t++) {
            g->at[t] = on_the_way(from + t, to + t, k, frames);
            tm_contact_set_target(g->s.contact, t, g->at + t, g->substeps);
        }
        if (tm_world_step(g->s.world, g->substeps) != TM_OK) {
            fail_at(g, i, "the step is unstable", 0, 0);
            return;
        }
        judge(g, i, false);
    }
}

static void act(stage *g, const session *s, int i) {
    const action *a = s->action + i;
    tm_tool_pose to[2] = {g->at[0], g->at[1]}, *mine = to + a->tool, *other = to + !a->tool;
    const double up = TOP_M + 0.008;
    switch (a->what) {
    case PRESS:
        memcpy(mine->tip_m, a->to_m, sizeof a->to_m);
        mine->tip_m[2] -= 0.004;
        break;
    case LIFT: mine->tip_m[2] = up; break;
    case CLOSE: mine->grip = 1; break;
    case OPEN: mine->grip = 0; break;
    case CROSS: memcpy(mine->tip_m, a->to_m, sizeof a->to_m), mine->tip_m[0] = -g->at[a->tool].tip_m[0]; break;
    case PINCH: /* from both sides to one place, below the surface */
        for (int t = 0; t < 2; t++) {
            memcpy(to[t].tip_m, a->to_m, sizeof a->to_m);
            to[t].tip_m[0] += t ? -0.003 : 0.003;
            to[t].tip_m[2] = fmin(a->to_m[2], TOP_M - 0.001);
        }
        break;
    case CUT: mine->active = s->mode[a->tool] != TM_TOOL_CAUTERY || !g->at[a->tool].active; break;
    case HAND_OVER: /* the other one comes here and closes, and this one opens */
        memcpy(other->tip_m, mine->tip_m, sizeof other->tip_m);
        other->tip_m[0] += a->tool ? 0.002 : -0.002;
        go(g, i, to, a->frames);
        other->grip = 1;
        go(g, i, to, 2);
        mine->grip = 0;
        break;
    case PULL: mine->tip_m[2] += 0.008, mine->roll_rad = a->roll_rad; break;
    case WAIT:
    case KINDS: break;
    }
    go(g, i, to, a->frames);
}

static verdict run_session(const session *s, bool tell) {
    stage g = open_stage(s);
    g.tell = tell;
    for (int i = 0; i < s->count && g.v.good; i++) {
        if (tell) print_message(" %s\n", KIND[s->action[i].what]);
        act(&g, s, i);
    }
    tm_tool_pose out[2] = {g.at[0], g.at[1]}; /* both open and withdraw */
    for (int t = 0; t < 2; t++) {
        out[t].grip = 0, out[t].roll_rad = 0, out[t].active = s->mode[t] != TM_TOOL_CAUTERY;
    }
    go(&g, s->count, out, 2 + (int)(s->fade_s / FRAME_S));
    for (int t = 0; t < 2; t++) out[t].tip_m[2] = TOP_M + 0.05;
    go(&g, s->count, out, 20);
    go(&g, s->count, out, FRAMES_AFTER);
    if (g.v.good) judge(&g, s->count, true);
    scene_destroy(&g.s);
    return g.v;
}

static bool drop_effect(session *s, int i) { return (void)s, (void)i, false; }

/* --- the test --- */

/* Seeds that exceeded a bound before contact had a passivity observer (contact_passivity.c), or when that observer
 * raised the viscous drag instead. */
static const uint64_t ONCE_BROKE[] = {3403, 4500, 6046, 9356};

typedef struct tally {
    double worst, farthest_m, hands_J;
    uint64_t worst_seed;
} tally;

static void take(void *to, uint64_t seed, const verdict *v) {
    tally *sum = to;
    if (v->worst > sum->worst) sum->worst = v->worst, sum->worst_seed = seed;
    sum->farthest_m = fmax(sum->farthest_m, v->farthest_m);
    sum->hands_J += v->hands_J;
}

static void test_random_sessions_stay_within_bounds(void **unused) {
    (void)unused;
    const bool few = test_is_sanitized();
    const session_range range =
        sessions_to_run(few ? 5 : 50, ONCE_BROKE, few ? 0 : sizeof ONCE_BROKE / sizeof *ONCE_BROKE);
    tally sum = {0};
    const int failed = run_sessions(&range, take, &sum);
    print_message(
        "%llu sessions, seeds from %llu: %.3f J through the hands, surplus at most %.2f of the bound (seed %llu), "
        "farthest %.1f mm\n",
        (unsigned long long)range.count, (unsigned long long)range.first, sum.hands_J, sum.worst,
        (unsigned long long)sum.worst_seed, 1e3 * sum.farthest_m);
    assert_int_equal(failed, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_random_sessions_stay_within_bounds)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
