/* What a hand notices first: a spike at first contact, a jerk when tissue tears away, one instrument's force in the
 * other, a stiff lump that rattles, a session that does not replay. Frames of 2 ms, as a controller of 500 Hz would
 * feel them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"
#include "tensormass/cut.h"
#include "tensormass/grasp.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"
enum { TOOLS = 2 };
static const double FRAME_S = 0.002, TOP_M = 0.024, RADIUS_M = 0.0035, HERE_M[2] = {0.0213, 0.0187};

typedef struct rig {
    bench b;
    tm_contact *contact;
    int tools;
    tm_tool_pose now[TOOLS];
    double force_N[TOOLS][3], peak_N[TOOLS], jump_N; /* of the last frame; largest; largest change of a force */
    bool finite, felt;
    outcome *o;
} rig;

/* A tip whose sphere is `deep_m` below the surface. */
static tm_tool_pose tip(double x, double y, double deep_m) {
    return (tm_tool_pose){.tip_m = {x, y, TOP_M + RADIUS_M - deep_m}, .active = true};
}

/* Tools (mode and start [tools]) stand upright over their starts. */
static bool rig_open(rig *r, bench_def def, int tools, const tm_tool_mode *mode, const tm_tool_pose *start,
                     outcome *o) {
    *r = (rig){.tools = tools, .finite = true, .o = o};
    if (!bench_open(&def, &r->b, o)) return false;
    tm_instrument_def tool[TOOLS];
    for (int i = 0; i < tools; i++) {
        r->now[i] = start[i];
        tool[i] = (tm_instrument_def){.mode = mode[i],
                                      .radius_m = RADIUS_M,
                                      .contact_length_m = 0.05,
                                      .trocar_m = {start[i].tip_m[0], start[i].tip_m[1], 0.15},
                                      .pose = start[i]};
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = tools, contact.instrument = tool;
    tm_grasp_def grasp = tm_grasp_def_default();
    tm_cut_def cut = tm_cut_def_default();
    tm_grasp *jaws;
    tm_error error = {0};
    o->x_name = "simulated s", o->y_name = "force N";
    if (tm_stage_contact(r->b.world, &contact, &r->contact, &error) == TM_OK &&
        tm_stage_grasp(r->b.world, r->contact, &grasp, &jaws, &error) == TM_OK &&
        (!def.cuttable || tm_stage_cut(r->b.world, r->contact, &cut, &error) == TM_OK))
        return true;
    bench_close(&r->b);
    refused(o, &error);
    return false;
}

static bench_def block(void) {
    bench_def def = bench_default();
    def.cells[0] = def.cells[1] = 10, def.cells[2] = 6;
    def.size_m[2] = TOP_M;
    for (int i = 0; i < 2; i++) {
        if (tm_material_young(5e3, 0.4, &def.material[i], NULL) != TM_OK) abort(); /* constants of ours */
        def.material[i].damping_1_s = 60;
    }
    return def;
}

static void frame(rig *r, const tm_tool_pose *to) {
    const int32_t n = (int32_t)ceil(FRAME_S / tm_world_step_s(r->b.world));
    tm_contact_begin_frame(r->contact, n, n);
    for (int i = 0; i < r->tools; i++) tm_contact_move(r->contact, i, &to[i], n);
    r->finite = r->finite && tm_world_step(r->b.world, n) == TM_OK;
    for (int i = 0; i < r->tools; i++) {
        const tm_tool_reaction reaction = tm_contact_reaction(r->contact, i);
        double change[3];
        for (int c = 0; c < 3; c++) change[c] = reaction.force_N[c] - r->force_N[i][c];
        if (r->felt) r->jump_N = fmax(r->jump_N, vnorm(change));
        memcpy(r->force_N[i], reaction.force_N, sizeof change);
        r->finite = r->finite && isfinite(vnorm(r->force_N[i]));
        r->peak_N[i] = fmax(r->peak_N[i], vnorm(r->force_N[i]));
        r->now[i] = to[i];
    }
    r->felt = true;
    series_add(r->o, tm_world_state(r->b.world)->time_s, vnorm(r->force_N[0]));
}

/* All tools go straight to `to` [tools] within `time_s`. */
static void go(rig *r, const tm_tool_pose *to, double time_s) {
    const int frames = (int)ceil(time_s / FRAME_S - 1e-9);
    tm_tool_pose from[TOOLS], at[TOOLS];
    memcpy(from, r->now, sizeof from);
    for (int k = 1; k <= frames && r->finite; k++) {
        for (int i = 0; i < r->tools; i++) {
            at[i] = to[i];
            for (int c = 0; c < 3; c++)
                at[i].tip_m[c] = from[i].tip_m[c] + (to[i].tip_m[c] - from[i].tip_m[c]) * k / frames;
        }
        frame(r, at);
    }
}

static void unstable(rig *r) { broken(r->o, "a force or displacement stopped being finite"); }

/* Comes down at a steady speed, stops dead 2 mm deep, stays. */
static void spike(bool quick, double speed_m_s, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE};
    const tm_tool_pose above = tip(HERE_M[0], HERE_M[1], -0.0005), deep = tip(HERE_M[0], HERE_M[1], 0.002);
    rig r;
    (void)quick;
    if (!rig_open(&r, block(), 1, mode, &above, o)) return;
    go(&r, &deep, 0.0025 / speed_m_s);
    go(&r, &deep, 1);
    const double rest_N = vnorm(r.force_N[0]);
    if (r.finite && rest_N > 0)
        stable(o, r.peak_N[0] / rest_N, "%.4g N at most, %.4g N at rest, largest change in 2 ms %.2g N", r.peak_N[0],
               rest_N, r.jump_N);
    else
        unstable(&r);
    bench_close(&r.b);
}

/* A lip between two slits, under the tool, goes all at once. */
static void tears(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE};
    const tm_tool_pose above = tip(HERE_M[0], HERE_M[1], -0.001), deep = tip(HERE_M[0], HERE_M[1], 0.003);
    bench_def def = block();
    rig r;
    int32_t gone = 0;
    (void)quick, (void)argument;
    def.cuttable = true;
    if (!rig_open(&r, def, 1, mode, &above, o)) return;
    go(&r, &deep, 0.4);
    go(&r, &deep, 0.4);
    const double before_N = vnorm(r.force_N[0]);
    r.peak_N[0] = r.jump_N = 0;
    for (int32_t t = 0; t < r.b.mesh->tet_count; t++) {
        double centre[3] = {0};
        for (int k = 0; k < 12; k++) centre[k % 3] += 0.25 * r.b.mesh->rest_m[3 * r.b.mesh->tet[4 * t + k / 3] + k % 3];
        if (centre[0] > 0.020 && centre[0] < 0.032 && fabs(centre[1] - 0.02) < 0.008 && centre[2] > TOP_M - 0.008)
            gone += tm_cut_remove(r.b.tissue, &t, 1, NULL, 0);
    }
    go(&r, &deep, 1);
    if (r.finite && before_N > 0 && gone > 0)
        stable(
            o, r.peak_N[0] / before_N,
            "%d tetrahedra beside and under the tip go at once: %.3g N before, never more than %.3g N after, largest "
            "change in 2 ms %.0f %% of it, %.3g N at rest",
            gone, before_N, r.peak_N[0], 100 * r.jump_N / before_N, vnorm(r.force_N[0]));
    else
        unstable(&r);
    bench_close(&r.b);
}

/* Two probes 9 mm apart, one deeper; then the same with the instruments' numbers exchanged. */
static void each_its_own(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE, TM_TOOL_PROBE};
    double force[2][TOOLS][3], off = 0;
    (void)quick, (void)argument;
    for (int run = 0; run < 2; run++) {
        tm_tool_pose above[TOOLS], deep[TOOLS];
        rig r;
        for (int i = 0; i < TOOLS; i++) {
            const int place = run ? 1 - i : i;
            above[i] = tip(HERE_M[0] + 0.009 * place, HERE_M[1], -0.001);
            deep[i] = tip(HERE_M[0] + 0.009 * place, HERE_M[1], place ? 0.004 : 0.002);
        }
        if (!rig_open(&r, block(), TOOLS, mode, above, o)) return;
        go(&r, deep, 0.5);
        go(&r, deep, 1);
        memcpy(force[run], r.force_N, sizeof force[run]);
        bench_close(&r.b);
        if (!r.finite) {
            unstable(&r);
            return;
        }
    }
    for (int i = 0; i < TOOLS; i++)
        for (int c = 0; c < 3; c++) off = fmax(off, fabs(force[0][i][c] - force[1][1 - i][c]));
    accurate(o, off / vnorm(force[0][1]), "%.4g N and %.4g N 9 mm apart; exchanged, they change by %.1e N",
             vnorm(force[0][0]), vnorm(force[0][1]), off);
}

static bool in_lump(const double centre_m[3]) {
    const double d[3] = {centre_m[0] - 0.02, centre_m[1] - 0.02, centre_m[2] - 0.014};
    return vnorm(d) < 0.007;
}

/* Slides over a lump 3 mm under the surface. */
static void lump(bool quick, double ratio, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE};
    const tm_tool_pose above = tip(0.0061, 0.0187, -0.001), beside = tip(0.0061, 0.0187, 0.003),
                       over = tip(0.0203, 0.0187, 0.003), beyond = tip(0.0341, 0.0187, 0.003);
    bench_def def = block();
    rig r;
    (void)quick;
    def.material_count = 2, def.second = in_lump;
    if (tm_material_young(5e3 * ratio, 0.4, &def.material[1], NULL) != TM_OK) abort();
    def.material[1].damping_1_s = def.material[0].damping_1_s;
    if (!rig_open(&r, def, 1, mode, &above, o)) return;
    go(&r, &beside, 0.4);
    const double soft_N = vnorm(r.force_N[0]);
    r.jump_N = 0;
    go(&r, &over, 0.71);
    const double stiff_N = vnorm(r.force_N[0]);
    go(&r, &beyond, 0.69);
    if (r.finite && soft_N > 0)
        stable(o, r.jump_N / r.peak_N[0], "%.3g N beside it, %.3g N over it; largest change in 2 ms %.2g N", soft_N,
               stiff_N, r.jump_N);
    else
        unstable(&r);
    bench_close(&r.b);
}

/* Grasped, lifted, cut beside; twice. */
static void replays(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_GRASPER, TM_TOOL_CAUTERY};
    uint64_t hash[2];
    double sum[2] = {0, 0};
    int32_t left = 0;
    (void)quick, (void)argument;
    for (int run = 0; run < 2; run++) {
        tm_tool_pose at[TOOLS] = {tip(0.014, 0.0187, -0.001), tip(0.028, 0.0187, -0.003)};
        bench_def def = block();
        rig r;
        def.cuttable = true;
        at[1].active = false;
        if (!rig_open(&r, def, TOOLS, mode, at, o)) return;
        at[0] = tip(0.014, 0.0187, 0.002), go(&r, at, 0.3), sum[run] += vnorm(r.force_N[0]);
        at[0].grip = 1, go(&r, at, 0.1), sum[run] += vnorm(r.force_N[0]);
        at[0] = tip(0.014, 0.0187, -0.004), at[0].grip = 1, go(&r, at, 0.5), sum[run] += vnorm(r.force_N[0]);
        at[1] = tip(0.026, 0.0187, 0.004), go(&r, at, 0.6), sum[run] += vnorm(r.force_N[1]);
        at[0].grip = 0, go(&r, at, 0.4), sum[run] += vnorm(r.force_N[0]);
        hash[run] = tm_world_hash(r.b.world);
        left = tm_tissue_alive_count(r.b.tissue) - r.b.mesh->tet_count;
        bench_close(&r.b);
        if (!r.finite) {
            unstable(&r);
            return;
        }
    }
    if (left == 0)
        broken(o, "nothing was cut");
    else
        accurate(o, hash[0] == hash[1] ? fabs(sum[0] - sum[1]) : 1,
                 "two runs of a session that grasps, lifts and cuts %d tetrahedra: state %016llx and %016llx", -left,
                 (unsigned long long)hash[0], (unsigned long long)hash[1]);
}

#define TORTURE "torture"
#define OVER_REST "largest force over the force at rest"
const hard_case cases_torture[] = {
    {TORTURE, "spike-1mm", "first contact at 1 mm/s, stopped dead 2 mm deep", STABLE, 1.05, OVER_REST, spike, 0.001},
    {TORTURE, "spike-10mm", "first contact at 10 mm/s, stopped dead", STABLE, 1.05, OVER_REST, spike, 0.01},
    {TORTURE, "spike-50mm", "first contact at 50 mm/s, stopped dead", STABLE, 1.05, OVER_REST, spike, 0.05},
    {TORTURE, "spike-100mm", "first contact at 100 mm/s, stopped dead", STABLE, 1.05, OVER_REST, spike, 0.1},
    {TORTURE, "tears-away", "the edge of a cut tears away under the tool", STABLE, 1.05,
     "largest force after over the force before", tears, 0},
    {TORTURE, "each-its-own", "two instruments, each with its own force", ACCURATE, 1e-6, "off, share of the larger",
     each_its_own, 0},
    {TORTURE, "lump-20", "a lump 20 times stiffer under the surface, slid over", STABLE, 0.02,
     "largest change in 2 ms, share of peak", lump, 20},
    {TORTURE, "replays", "a session of two hands, run again", ACCURATE, 0, "difference, to the bit", replays, 0},
};
const int cases_torture_count = sizeof cases_torture / sizeof *cases_torture;
