/* Tools: teleporting, spinning, fast, deep, from inside, two in one tetrahedron, frames of any length. Each case ends
 * with the tool withdrawn and the tissue free: the excited motion must decay, or the case is broken. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "stability.h"

static const double TOP_M = 0.04;

typedef struct arena {
    rig r;
    double peak_N, deepest_m;
    bool capped, inside;
} arena;

static tm_tool_pose at(double x, double y, double z) { return (tm_tool_pose){.tip_m = {x, y, z}, .active = true}; }

static const tm_tool_pose away[RIG_TOOLS] = {{.tip_m = {0.02, 0.02, 0.1}, .active = true},
                                             {.tip_m = {0.06, 0.02, 0.1}, .active = true}};

static bool arena_open(arena *a, int tools, outcome *o) {
    rig_def def = rig_default(tools, away);
    memset(a, 0, sizeof *a);
    def.bench.cells[0] = def.bench.cells[1] = def.bench.cells[2] = 6;
    def.bench.material[0].damping_1_s = 40;
    if (tools > 1) def.tool[1].trocar_m[0] = 0.12, def.tool[1].trocar_m[2] = 0.16;
    return rig_open(&def, &a->r, "force N", o);
}

/* Runs one frame; `to` [tools], null: all stay. */
static void frame(arena *a, double frame_s, const tm_tool_pose *to, bool jump) {
    rig *r = &a->r;
    double total = 0;
    if (to) memcpy(r->at, to, sizeof *to * (size_t)r->tools);
    rig_steps(r, (int32_t)ceil(frame_s / tm_world_step_s(r->b.world)), 4, jump);
    for (int i = 0; i < r->tools; i++) {
        const uint32_t flags = (uint32_t)tm_contact_reaction(r->contact, i).flags;
        const double *f = r->force_N[i], size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        a->peak_N = fmax(a->peak_N, size), total += size;
        a->capped |= (flags & TM_REACTION_CAPPED) != 0, a->inside |= (flags & TM_REACTION_INSIDE) != 0;
    }
    const tm_state *s = tm_world_state(r->b.world);
    for (int32_t i = 0; i < 3 * r->b.mesh->vertex_count; i++) a->deepest_m = fmax(a->deepest_m, fabs(s->u_m[i]));
    series_add(r->o, s->time_s, total);
}

/* Withdraws the tools, lets the tissue settle, and judges the remaining motion. */
static void arena_close(arena *a, const char *words) {
    frame(a, 0.005, away, true);
    for (int i = 0; i < 60; i++) frame(a, 0.05, NULL, false);
    double left = 0;
    const tm_state *s = tm_world_state(a->r.b.world);
    for (int32_t i = 0; i < 3 * a->r.b.mesh->vertex_count; i++) left = fmax(left, fabs(s->u_m[i]));
    if (!a->r.finite)
        broken(a->r.o, "%s: a displacement or force stopped being finite", words);
    else
        stable(a->r.o, left,
               "%s: peak force %.3g N%s%s, largest displacement %.1f mm; %.1e m left after 3 s without the tool", words,
               a->peak_N, a->capped ? " (capped, flagged)" : "", a->inside ? " (inside, flagged)" : "",
               1e3 * a->deepest_m, left);
    app_bench_close(&a->r.b);
}

static void teleport(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 1, o)) return;
    uint64_t seed = 42;
    for (int i = 0; i < (quick ? 60 : 1000); i++) {
        tm_tool_pose p =
            at(0.02 + 0.03 * random_unit(&seed), 0.02 + 0.03 * random_unit(&seed), 0.025 + 0.035 * random_unit(&seed));
        frame(&a, 0.033, &p, true);
    }
    arena_close(&a, "placed anywhere at every frame");
}

static void jump_along(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 1, o)) return;
    uint64_t seed = 43;
    for (int i = 0; i < (quick ? 60 : 1000); i++) {
        tm_tool_pose p =
            at(0.02 + 0.03 * random_unit(&seed), 0.02 + 0.03 * random_unit(&seed), 0.025 + 0.035 * random_unit(&seed));
        frame(&a, 0.033, &p, false);
    }
    arena_close(&a, "moved anywhere within every frame");
}

static void spin(bool quick, double turns_per_s, outcome *o) {
    arena a;
    if (!arena_open(&a, 1, o)) return;
    for (int i = 0; i < (quick ? 60 : 600); i++) {
        double t = 0.033 * i, angle = 2 * M_PI * turns_per_s * t;
        tm_tool_pose p = at(0.02 + 0.01 * cos(angle), 0.02 + 0.01 * sin(angle), TOP_M - 0.003);
        p.roll_rad = angle;
        frame(&a, 0.033, &p, false);
    }
    arena_close(&a, "circling and rolling in contact");
}

static void from_inside(bool quick, double argument, outcome *o) {
    (void)quick, (void)argument;
    arena a;
    if (!arena_open(&a, 1, o)) return;
    tm_tool_pose p = at(0.02, 0.02, 0.02);
    frame(&a, 0.033, &p, true);
    for (int i = 0; i < 10; i++) frame(&a, 0.033, NULL, false);
    for (int i = 1; i <= 20; i++) {
        p = at(0.02, 0.02, 0.02 + 0.002 * i);
        frame(&a, 0.033, &p, false);
    }
    for (int i = 1; i <= 14; i++) { /* and again from outside, which must give a force */
        p = at(0.02, 0.02, 0.06 - 0.002 * i);
        frame(&a, 0.033, &p, false);
    }
    if (a.peak_N <= 0) {
        broken(o, "after leaving the tissue the tool no longer touches it");
        app_bench_close(&a.r.b);
        return;
    }
    arena_close(&a, "placed inside, drawn out, pressed again");
}

static void plunge(bool quick, double speed_m_s, outcome *o) {
    arena a;
    if (!arena_open(&a, 1, o)) return;
    for (int pass = 0; pass < (quick ? 2 : 20); pass++)
        for (int way = -1; way <= 1; way += 2) {
            double from = way < 0 ? TOP_M + 0.01 : TOP_M - 0.02;
            int n = (int)ceil(0.03 / (speed_m_s * 0.005));
            for (int i = 1; i <= n; i++) {
                tm_tool_pose p = at(0.02, 0.02, from + way * 0.03 * i / n);
                frame(&a, 0.005, &p, false);
            }
        }
    arena_close(&a, "plunged to half the block's height and out");
}

static void both_in_one(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 2, o)) return;
    for (int i = 0; i < (quick ? 60 : 400); i++) {
        double deep = 0.006 * fmin(1, i / 30.0);
        tm_tool_pose p[RIG_TOOLS] = {at(0.0201, 0.0201, TOP_M - deep), at(0.0199, 0.0202, TOP_M - deep)};
        frame(&a, 0.033, p, false);
    }
    arena_close(&a, "two tips on one triangle");
}

static void pinch(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 2, o)) return;
    for (int i = 0; i < (quick ? 60 : 400); i++) {
        double close = 0.015 * fmin(1, i / 30.0);
        tm_tool_pose p[RIG_TOOLS] = {at(-0.004 + close, 0.02, 0.03), at(0.044 - close, 0.02, 0.03)};
        frame(&a, 0.033, p, false);
    }
    arena_close(&a, "the block pinched between two shafts");
}

static void frame_length(bool quick, double frame_s, outcome *o) {
    arena a;
    if (!arena_open(&a, 1, o)) return;
    int n = quick ? 8 : 40;
    if (frame_s < 0.1) n *= 5;
    for (int i = 0; i < n; i++) {
        double z = TOP_M - 0.004 + 0.008 * cos(2 * M_PI * i * frame_s / 1.3);
        tm_tool_pose p = at(0.02, 0.02, z);
        frame(&a, frame_s, &p, false);
    }
    arena_close(&a, "pressed and let go");
}

/* Holds a tool still on damped tissue: the force becomes constant and stays. */
static void standing(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 1, o)) return;
    tm_tool_pose p = at(0.02, 0.02, TOP_M - 0.004);
    for (int i = 0; i < 60; i++) frame(&a, 0.033, &p, false);
    double first = a.r.force_N[0][2], worst = 0;
    for (int i = 0; i < (quick ? 300 : 3000); i++) {
        frame(&a, 0.033, NULL, false);
        worst = fmax(worst, fabs(a.r.force_N[0][2] / first - 1));
    }
    if (a.r.finite && first > 0)
        accurate(o, worst, "%.4g N, within %.1e of it for %d s", first, worst, quick ? 10 : 100);
    else
        broken(o, "no steady force");
    app_bench_close(&a.r.b);
}

#define TOOL "tool"
#define LEFT "m left after withdrawal"
const hard_case cases_tool[] = {
    {TOOL, "tool-still", "a tool that stands still in contact", ACCURATE, 1e-6, "change of force", standing, 0},
    {TOOL, "tool-teleports", "a tool placed anywhere, also inside, at every frame", STABLE, 1e-6, LEFT, teleport, 0},
    {TOOL, "tool-jumps", "a tool that moves anywhere within every frame, up to 3 m/s", STABLE, 1e-6, LEFT, jump_along,
     0},
    {TOOL, "tool-spins", "circling in contact at 5 turns a second", STABLE, 1e-6, LEFT, spin, 5},
    {TOOL, "tool-inside", "a tool that enters from inside", STABLE, 1e-6, LEFT, from_inside, 0},
    {TOOL, "tool-0.1", "plunging at 0.1 m/s", STABLE, 1e-6, LEFT, plunge, 0.1},
    {TOOL, "tool-1", "plunging at 1 m/s", STABLE, 1e-6, LEFT, plunge, 1},
    {TOOL, "two-in-one", "both instruments in one tetrahedron", STABLE, 1e-6, LEFT, both_in_one, 0},
    {TOOL, "two-pinch", "tissue pinched between two instruments", STABLE, 1e-6, LEFT, pinch, 0},
    {TOOL, "frame-5ms", "frames of 5 ms", STABLE, 1e-6, LEFT, frame_length, 0.005},
    {TOOL, "frame-100ms", "frames of 100 ms", STABLE, 1e-6, LEFT, frame_length, 0.1},
    {TOOL, "frame-2s", "frames of 2 s", STABLE, 1e-6, LEFT, frame_length, 2},
};
const int cases_tool_count = sizeof cases_tool / sizeof *cases_tool;
