/* Hard tools: teleporting, spinning, fast, deep, from inside, two in one tetrahedron, frames of any length. Each ends
 * with the tool withdrawn and the tissue left alone: what the abuse did must die out, or the case is broken. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "stability.h"

enum { TOOLS = 2 };
static const double TOP_M = 0.04;

typedef struct arena {
    bench b;
    tm_contact *contact;
    int tools;
    tm_tool_pose now[TOOLS];
    double peak_N, deepest_m;
    bool capped, inside, finite;
    outcome *o;
} arena;

static tm_tool_pose at(double x, double y, double z) { return (tm_tool_pose){.tip_m = {x, y, z}, .active = true}; }

static const tm_tool_pose away = {.tip_m = {0.02, 0.02, 0.1}, .active = true};

static bool arena_open(arena *a, int tools, double damping, outcome *o) {
    static const double trocar[TOOLS][3] = {{0.02, 0.02, 0.2}, {0.12, 0.02, 0.16}};
    bench_def def = bench_default();
    memset(a, 0, sizeof *a);
    a->o = o, a->tools = tools, a->finite = true;
    def.cells[0] = def.cells[1] = 6, def.cells[2] = 6;
    def.material[0].damping_1_s = damping;
    if (!bench_open(&def, &a->b, o)) return false;
    tm_instrument_def tool[TOOLS];
    for (int i = 0; i < tools; i++) {
        a->now[i] = away;
        a->now[i].tip_m[0] += 0.04 * i;
        tool[i] =
            (tm_instrument_def){.mode = TM_TOOL_PROBE, .radius_m = 0.0025, .contact_length_m = 0.1, .pose = a->now[i]};
        memcpy(tool[i].trocar_m, trocar[i], sizeof trocar[i]);
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = tools, contact.instrument = tool;
    tm_error error = {0};
    o->x_name = "simulated s", o->y_name = "force N";
    if (tm_stage_contact(a->b.world, &contact, &a->contact, &error) == TM_OK) return true;
    bench_close(&a->b);
    refused(o, &error);
    return false;
}

/* One frame; `to` [tools], null: all stay. */
static void frame(arena *a, double frame_s, const tm_tool_pose *to, bool jump) {
    int32_t n = (int32_t)ceil(frame_s / tm_world_step_s(a->b.world));
    tm_contact_begin_frame(a->contact, n, n < 4 ? n : 4);
    for (int i = 0; i < a->tools; i++) {
        if (to) a->now[i] = to[i];
        if (jump)
            tm_contact_place(a->contact, i, &a->now[i]);
        else
            tm_contact_move(a->contact, i, &a->now[i], n);
    }
    a->finite = a->finite && tm_world_step(a->b.world, n) == TM_OK;
    double total = 0;
    for (int i = 0; i < a->tools; i++) {
        tm_tool_reaction r = tm_contact_reaction(a->contact, i);
        double f = sqrt(r.force_N[0] * r.force_N[0] + r.force_N[1] * r.force_N[1] + r.force_N[2] * r.force_N[2]);
        a->finite = a->finite && isfinite(f);
        a->peak_N = fmax(a->peak_N, f), total += f;
        a->capped |= (r.flags & TM_REACTION_CAPPED) != 0, a->inside |= (r.flags & TM_REACTION_INSIDE) != 0;
    }
    const tm_state *s = tm_world_state(a->b.world);
    for (int32_t i = 0; i < 3 * a->b.mesh->vertex_count; i++) a->deepest_m = fmax(a->deepest_m, fabs(s->u_m[i]));
    series_add(a->o, s->time_s, total);
}

/* Withdraws, lets the tissue ring out, and judges what is left. */
static void arena_close(arena *a, const char *words) {
    tm_tool_pose out[TOOLS] = {away, away};
    out[1].tip_m[0] += 0.04;
    frame(a, 0.005, out, true);
    for (int i = 0; i < 60; i++) frame(a, 0.05, NULL, false);
    double left = 0;
    const tm_state *s = tm_world_state(a->b.world);
    for (int32_t i = 0; i < 3 * a->b.mesh->vertex_count; i++) left = fmax(left, fabs(s->u_m[i]));
    if (!a->finite)
        broken(a->o, "%s: a displacement or force stopped being finite", words);
    else
        stable(a->o, left,
               "%s: peak force %.3g N%s%s, largest displacement %.1f mm; %.1e m left after 3 s without the tool", words,
               a->peak_N, a->capped ? " (capped, flagged)" : "", a->inside ? " (inside, flagged)" : "",
               1e3 * a->deepest_m, left);
    bench_close(&a->b);
}

static void teleport(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 1, 40, o)) return;
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
    if (!arena_open(&a, 1, 40, o)) return;
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
    if (!arena_open(&a, 1, 40, o)) return;
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
    if (!arena_open(&a, 1, 40, o)) return;
    tm_tool_pose p = at(0.02, 0.02, 0.02);
    frame(&a, 0.033, &p, true);
    for (int i = 0; i < 10; i++) frame(&a, 0.033, NULL, false);
    for (int i = 1; i <= 20; i++) {
        p = at(0.02, 0.02, 0.02 + 0.002 * i);
        frame(&a, 0.033, &p, false);
    }
    for (int i = 1; i <= 14; i++) { /* and again from outside, which must be felt */
        p = at(0.02, 0.02, 0.06 - 0.002 * i);
        frame(&a, 0.033, &p, false);
    }
    if (a.peak_N <= 0) {
        broken(o, "after leaving the tissue the tool no longer touches it");
        bench_close(&a.b);
        return;
    }
    arena_close(&a, "placed inside, drawn out, pressed again");
}

static void plunge(bool quick, double speed_m_s, outcome *o) {
    arena a;
    if (!arena_open(&a, 1, 40, o)) return;
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
    if (!arena_open(&a, 2, 40, o)) return;
    for (int i = 0; i < (quick ? 60 : 400); i++) {
        double deep = 0.006 * fmin(1, i / 30.0);
        tm_tool_pose p[TOOLS] = {at(0.0201, 0.0201, TOP_M - deep), at(0.0199, 0.0202, TOP_M - deep)};
        frame(&a, 0.033, p, false);
    }
    arena_close(&a, "two tips on one triangle");
}

static void pinch(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 2, 40, o)) return;
    for (int i = 0; i < (quick ? 60 : 400); i++) {
        double close = 0.015 * fmin(1, i / 30.0);
        tm_tool_pose p[TOOLS] = {at(-0.004 + close, 0.02, 0.03), at(0.044 - close, 0.02, 0.03)};
        frame(&a, 0.033, p, false);
    }
    arena_close(&a, "the block pinched between two shafts");
}

static void frame_length(bool quick, double frame_s, outcome *o) {
    arena a;
    if (!arena_open(&a, 1, 40, o)) return;
    int n = quick ? 8 : 40;
    if (frame_s < 0.1) n *= 5;
    for (int i = 0; i < n; i++) {
        double z = TOP_M - 0.004 + 0.008 * cos(2 * M_PI * i * frame_s / 1.3);
        tm_tool_pose p = at(0.02, 0.02, z);
        frame(&a, frame_s, &p, false);
    }
    arena_close(&a, "pressed and let go");
}

/* A tool held still on damped tissue: the force comes to rest and stays. */
static void standing(bool quick, double argument, outcome *o) {
    (void)argument;
    arena a;
    if (!arena_open(&a, 1, 40, o)) return;
    tm_tool_pose p = at(0.02, 0.02, TOP_M - 0.004);
    for (int i = 0; i < 60; i++) frame(&a, 0.033, &p, false);
    double first = tm_contact_reaction(a.contact, 0).force_N[2], worst = 0;
    for (int i = 0; i < (quick ? 300 : 3000); i++) {
        frame(&a, 0.033, NULL, false);
        worst = fmax(worst, fabs(tm_contact_reaction(a.contact, 0).force_N[2] / first - 1));
    }
    if (a.finite && first > 0)
        accurate(o, worst, "%.4g N, within %.1e of it for %d s", first, worst, quick ? 10 : 100);
    else
        broken(o, "no steady force");
    bench_close(&a.b);
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
