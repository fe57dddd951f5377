/* Artefacts that a hand notices first: a spike at first contact, a jerk when tissue tears, one instrument's force in
 * the other, a stiff lump that rattles, a session that does not replay. Frames of 2 ms, as for a controller of 500
 * Hz. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

enum { TOOLS = RIG_TOOLS };
static const double FRAME_S = 0.002, TOP_M = 0.024, RADIUS_M = 0.0035, HERE_M[2] = {0.0213, 0.0187};

typedef struct torture {
    rig r;
    double peak_N[TOOLS], jump_N; /* maximum force; maximum change of a force between frames */
    bool felt;
} torture;

/* Returns the pose of a tip whose sphere is `deep_m` below the surface. */
static tm_tool_pose tip(double x, double y, double deep_m) {
    return (tm_tool_pose){.tip_m = {x, y, TOP_M + RADIUS_M - deep_m}, .active = true};
}

static app_bench_def block(void) {
    app_bench_def def = bench_default();
    def.cells[0] = def.cells[1] = 10, def.cells[2] = 6;
    def.size_m[2] = TOP_M;
    for (int i = 0; i < 2; i++) {
        if (tm_material_young(5e3, 0.4, &def.material[i], NULL) != TM_OK) abort(); /* constants of this file */
        def.material[i].damping_1_s = 60;
    }
    return def;
}

/* Opens a block with tools (mode and start [tools]) upright over their starts. */
static bool torture_open(torture *x, app_bench_def block, int tools, const tm_tool_mode *mode,
                         const tm_tool_pose *start, outcome *o) {
    rig_def def = rig_default(tools, start);
    *x = (torture){.felt = false};
    def.bench = block, def.jaws = true;
    for (int i = 0; i < tools; i++) {
        def.tool[i].mode = mode[i], def.tool[i].radius_m = RADIUS_M, def.tool[i].contact_length_m = 0.05;
        def.tool[i].trocar_m[2] = 0.15;
    }
    return rig_open(&def, &x->r, "force N", o);
}

static void frame(torture *x) {
    rig *r = &x->r;
    double previous_N[TOOLS][3];
    memcpy(previous_N, r->force_N, sizeof previous_N);
    rig_frame(r, FRAME_S, INT32_MAX);
    for (int i = 0; i < r->tools; i++) {
        double change[3];
        for (int c = 0; c < 3; c++) change[c] = r->force_N[i][c] - previous_N[i][c];
        if (x->felt) x->jump_N = fmax(x->jump_N, vnorm(change));
        x->peak_N[i] = fmax(x->peak_N[i], vnorm(r->force_N[i]));
    }
    x->felt = true;
    series_add(r->o, tm_world_state(r->b.world)->time_s, vnorm(r->force_N[0]));
}

/* Moves all tools straight to `to` [tools] within `time_s`. */
static void go(torture *x, const tm_tool_pose *to, double time_s) {
    const int frames = (int)ceil(time_s / FRAME_S - 1e-9);
    tm_tool_pose from[TOOLS];
    memcpy(from, x->r.at, sizeof from);
    for (int k = 1; k <= frames && x->r.finite; k++) {
        rig_lead(&x->r, from, to, k, frames);
        frame(x);
    }
}

static void unstable(torture *x) { broken(x->r.o, "a force or displacement stopped being finite"); }

/* Descends at constant speed, stops abruptly 2 mm deep, stays. */
static void spike(bool quick, double speed_m_s, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE};
    const tm_tool_pose above = tip(HERE_M[0], HERE_M[1], -0.0005), deep = tip(HERE_M[0], HERE_M[1], 0.002);
    torture x;
    (void)quick;
    if (!torture_open(&x, block(), 1, mode, &above, o)) return;
    go(&x, &deep, 0.0025 / speed_m_s);
    go(&x, &deep, 1);
    const double rest_N = vnorm(x.r.force_N[0]);
    if (x.r.finite && rest_N > 0)
        stable(o, x.peak_N[0] / rest_N, "%.4g N at most, %.4g N at rest, largest change in 2 ms %.2g N", x.peak_N[0],
               rest_N, x.jump_N);
    else
        unstable(&x);
    app_bench_close(&x.r.b);
}

/* Removes a lip between two slits, under the tool, at once. */
static void tears(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE};
    const tm_tool_pose above = tip(HERE_M[0], HERE_M[1], -0.001), deep = tip(HERE_M[0], HERE_M[1], 0.003);
    app_bench_def def = block();
    torture x;
    int32_t gone = 0;
    (void)quick, (void)argument;
    def.cuttable = true;
    if (!torture_open(&x, def, 1, mode, &above, o)) return;
    go(&x, &deep, 0.4);
    go(&x, &deep, 0.4);
    const double previous_N = vnorm(x.r.force_N[0]);
    x.peak_N[0] = x.jump_N = 0;
    for (int32_t t = 0; t < x.r.b.mesh->tet_count; t++) {
        double centre[3] = {0};
        for (int k = 0; k < 12; k++)
            centre[k % 3] += 0.25 * x.r.b.mesh->rest_m[3 * x.r.b.mesh->tet[4 * t + k / 3] + k % 3];
        if (centre[0] > 0.020 && centre[0] < 0.032 && fabs(centre[1] - 0.02) < 0.008 && centre[2] > TOP_M - 0.008)
            gone += tm_cut_remove(x.r.b.tissue, &t, 1, NULL, 0);
    }
    go(&x, &deep, 1);
    if (x.r.finite && previous_N > 0 && gone > 0)
        stable(
            o, x.peak_N[0] / previous_N,
            "%d tetrahedra beside and under the tip go at once: %.3g N before, never more than %.3g N after, largest "
            "change in 2 ms %.0f %% of it, %.3g N at rest",
            gone, previous_N, x.peak_N[0], 100 * x.jump_N / previous_N, vnorm(x.r.force_N[0]));
    else
        unstable(&x);
    app_bench_close(&x.r.b);
}

/* Presses two probes 9 mm apart, one deeper; then again with the instruments' numbers exchanged. */
static void each_its_own(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_PROBE, TM_TOOL_PROBE};
    double force[2][TOOLS][3], off = 0;
    (void)quick, (void)argument;
    for (int run = 0; run < 2; run++) {
        tm_tool_pose above[TOOLS], deep[TOOLS];
        torture x;
        for (int i = 0; i < TOOLS; i++) {
            const int place = run ? 1 - i : i;
            above[i] = tip(HERE_M[0] + 0.009 * place, HERE_M[1], -0.001);
            deep[i] = tip(HERE_M[0] + 0.009 * place, HERE_M[1], place ? 0.004 : 0.002);
        }
        if (!torture_open(&x, block(), TOOLS, mode, above, o)) return;
        go(&x, deep, 0.5);
        go(&x, deep, 1);
        memcpy(force[run], x.r.force_N, sizeof force[run]);
        app_bench_close(&x.r.b);
        if (!x.r.finite) {
            unstable(&x);
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
    app_bench_def def = block();
    torture x;
    (void)quick;
    def.material_count = 2, def.second = in_lump;
    if (tm_material_young(5e3 * ratio, 0.4, &def.material[1], NULL) != TM_OK) abort();
    def.material[1].damping_1_s = def.material[0].damping_1_s;
    if (!torture_open(&x, def, 1, mode, &above, o)) return;
    go(&x, &beside, 0.4);
    const double soft_N = vnorm(x.r.force_N[0]);
    x.jump_N = 0;
    go(&x, &over, 0.71);
    const double stiff_N = vnorm(x.r.force_N[0]);
    go(&x, &beyond, 0.69);
    if (x.r.finite && soft_N > 0)
        stable(o, x.jump_N / x.peak_N[0], "%.3g N beside it, %.3g N over it; largest change in 2 ms %.2g N", soft_N,
               stiff_N, x.jump_N);
    else
        unstable(&x);
    app_bench_close(&x.r.b);
}

/* Grasps, lifts and cuts nearby, twice. */
static void replays(bool quick, double argument, outcome *o) {
    static const tm_tool_mode mode[TOOLS] = {TM_TOOL_GRASPER, TM_TOOL_CAUTERY};
    uint64_t hash[2];
    double sum[2] = {0, 0};
    int32_t left = 0;
    (void)quick, (void)argument;
    for (int run = 0; run < 2; run++) {
        tm_tool_pose at[TOOLS] = {tip(0.014, 0.0187, -0.001), tip(0.028, 0.0187, -0.003)};
        app_bench_def def = block();
        torture x;
        def.cuttable = true;
        at[1].active = false;
        if (!torture_open(&x, def, TOOLS, mode, at, o)) return;
        at[0] = tip(0.014, 0.0187, 0.002), go(&x, at, 0.3), sum[run] += vnorm(x.r.force_N[0]);
        at[0].grip = 1, go(&x, at, 0.1), sum[run] += vnorm(x.r.force_N[0]);
        at[0] = tip(0.014, 0.0187, -0.004), at[0].grip = 1, go(&x, at, 0.5), sum[run] += vnorm(x.r.force_N[0]);
        at[1] = tip(0.026, 0.0187, 0.004), go(&x, at, 0.6), sum[run] += vnorm(x.r.force_N[1]);
        at[0].grip = 0, go(&x, at, 0.4), sum[run] += vnorm(x.r.force_N[0]);
        hash[run] = tm_world_hash(x.r.b.world);
        left = tm_tissue_alive_count(x.r.b.tissue) - x.r.b.mesh->tet_count;
        app_bench_close(&x.r.b);
        if (!x.r.finite) {
            unstable(&x);
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
