/* Hard friction: coefficients without bounds of sense, a step without skin, a hand that shakes faster than a frame, two
 * tools that drag the tissue between them, a pause of minutes inside the cone. */
#include <math.h>
#include <stdlib.h>

#include "stability.h"

enum { TOOLS = 2 };
static const double TOP_M = 0.04, FRAME_S = 0.005, RADIUS_M = 0.0025;

typedef struct rubbing {
    bench b;
    tm_contact *contact;
    tm_friction *friction;
    tm_friction_coefficient coefficient;
    double over_cone, peak_N, hands_J, made_J;
    bool finite;
    outcome *o;
} rubbing;

static bool open_rubbing(rubbing *r, double at_rest, double sliding, double skin_m_N, double damping, outcome *o) {
    bench_def def = bench_default();
    *r = (rubbing){.coefficient = {at_rest, sliding}, .finite = true, .o = o};
    def.material[0].damping_1_s = damping;
    if (!bench_open(&def, &r->b, o)) return false;
    tm_instrument_def tool[TOOLS];
    for (int t = 0; t < TOOLS; t++) {
        const double x = 0.012 + 0.016 * t;
        tool[t] = (tm_instrument_def){.radius_m = RADIUS_M,
                                      .contact_length_m = 0.1,
                                      .trocar_m = {x, 0.02, 0.2},
                                      .pose = {.tip_m = {x, 0.02, TOP_M + 0.003}, .active = true}};
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = TOOLS, contact.instrument = tool, contact.skin_compliance_m_N = skin_m_N;
    tm_friction_def friction = tm_friction_def_default();
    for (int t = 0; t < TOOLS; t++) friction.instrument[t] = r->coefficient;
    tm_error error = {0};
    o->x_name = "simulated s", o->y_name = "force along the surface over what presses";
    if (tm_stage_contact(r->b.world, &contact, &r->contact, &error) == TM_OK &&
        (at_rest == 0 || tm_stage_friction(r->b.world, r->contact, &friction, &r->friction, &error) == TM_OK) &&
        tm_stage_energy(r->b.world, &error) == TM_OK)
        return true;
    bench_close(&r->b);
    refused(o, &error);
    return false;
}

static void look_at_grips(rubbing *r, int t) {
    tm_friction_grip grip[64];
    const int32_t there = r->friction ? tm_friction_grips(r->friction, t, grip, 64) : 0, n = there < 64 ? there : 64;
    double along = 0, pressed = 0;
    for (int32_t i = 0; i < n; i++) {
        const double *f = grip[i].force_N, size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        r->over_cone = fmax(r->over_cone, size / grip[i].pressed_N - grip[i].coefficient);
        along += size, pressed += grip[i].pressed_N;
    }
    if (t == 0 && pressed > 0) series_add(r->o, tm_world_state(r->b.world)->time_s, along / pressed);
}

/* Tools to x[t] aside of where they began, `deep` into the surface. */
static void frame(rubbing *r, const double x_m[TOOLS], double deep_m) {
    const int32_t n = (int32_t)ceil(FRAME_S / tm_world_step_s(r->b.world));
    tm_contact_begin_frame(r->contact, n, 1);
    for (int t = 0; t < TOOLS; t++) {
        const tm_tool_pose to = {.tip_m = {0.012 + 0.016 * t + x_m[t], 0.02, TOP_M + RADIUS_M - deep_m},
                                 .active = true};
        tm_contact_move(r->contact, t, &to, n);
    }
    r->finite = r->finite && tm_world_step(r->b.world, n) == TM_OK;
    tm_energy e;
    if (tm_world_energy(r->b.world, &e, NULL) == TM_OK) {
        r->hands_J = fmax(r->hands_J, fabs(e.hand_J[0]) + fabs(e.hand_J[1]));
        r->made_J = fmax(r->made_J, e.made_J);
    }
    for (int t = 0; t < TOOLS; t++) {
        const tm_tool_reaction f = tm_contact_reaction(r->contact, t);
        r->peak_N = fmax(r->peak_N, fabs(f.force_N[0]) + fabs(f.force_N[1]) + fabs(f.force_N[2]));
        look_at_grips(r, t);
    }
}

static void press_in(rubbing *r, double deep_m) {
    for (int i = 1; i <= 40; i++) frame(r, (double[TOOLS]){0, 0}, deep_m * i / 40);
}

/* To and fro at 20 Hz, the tools against each other: the tissue between them is dragged both ways. */
static void drags(rubbing *r, bool quick) {
    press_in(r, 0.003);
    for (int i = 0; i < (quick ? 120 : 1200); i++) {
        const double x = 0.004 * sin(0.63 * i);
        frame(r, (double[TOOLS]){x, -x}, 0.003);
    }
}

/* No force outside its cone, and contact makes no more out of nothing than without friction (facets of four tool radii
 * and the film's drag at 0.5 m/s make some): a share of what the hands gave. */
static void judge(double at_rest, double sliding, double skin_m_N, bool quick, outcome *o) {
    rubbing r, plain;
    outcome ignored = {0};
    if (!open_rubbing(&r, at_rest, sliding, skin_m_N, 60, o)) return;
    drags(&r, quick);
    bench_close(&r.b);
    if (!open_rubbing(&plain, 0, 0, skin_m_N, 60, &ignored)) abort();
    drags(&plain, quick);
    bench_close(&plain.b);
    const double made = (r.made_J - plain.made_J) / r.hands_J;
    if (!r.finite || !(r.peak_N < 200))
        broken(o, "%s, %.3g N", r.finite ? "the force grew" : "a step failed", r.peak_N);
    else if (r.over_cone > 1e-6)
        broken(o, "a force is outside its cone by %.1e of what presses", r.over_cone);
    else
        stable(
            o, fmax(made, 0),
            "two tools shaken at 20 Hz: at most %.2f N, no force outside its cone, contact made %.2e J (%.2e without "
            "friction) of the hands' %.2e",
            r.peak_N, r.made_J, plain.made_J, r.hands_J);
}

static void coefficient(bool quick, double at_rest, outcome *o) {
    judge(at_rest, at_rest < 1 ? 0.5 * at_rest : at_rest, 0.5e-3, quick, o);
}

static void skin(bool quick, double skin_m_N, outcome *o) { judge(0.4, 0.3, skin_m_N, quick, o); }

/* What it bears when it is held still inside its cone, and minutes later. */
static void pause_for(bool quick, double minutes, outcome *o) {
    rubbing r;
    if (!open_rubbing(&r, 0.5, 0.4, 0.5e-3, 60, o)) return;
    double x[TOOLS] = {0, 0};
    press_in(&r, 0.003);
    for (int i = 0; i < 40; i++) x[0] += 2e-5, frame(&r, x, 0.003);
    for (int i = 0; i < 300; i++) frame(&r, x, 0.003);
    const tm_tool_reaction was = tm_contact_reaction(r.contact, 0);
    const int frames = (int)(60 * (quick ? 0.05 : minutes) / FRAME_S);
    for (int i = 0; i < frames; i++) frame(&r, x, 0.003);
    const tm_tool_reaction is = tm_contact_reaction(r.contact, 0);
    double crept = 0;
    for (int c = 0; c < 3; c++) crept = fmax(crept, fabs(is.force_N[c] - was.force_N[c]));
    if (r.finite && fabs(was.force_N[0]) > 0.01)
        accurate(o, crept, "held with %.3f N aside, %.2g N of it gone after %.3g min", fabs(was.force_N[0]), crept,
                 frames * FRAME_S / 60);
    else
        broken(o, "it does not hold: %.3g N aside", was.force_N[0]);
    bench_close(&r.b);
}

#define FRICTION "tool"
const hard_case cases_friction[] = {
    {FRICTION, "friction-0.3", "friction, 0.3 at rest and half of it sliding", STABLE, 0.03, "made more than without",
     coefficient, 0.3},
    {FRICTION, "friction-2", "friction, 2.0: twice what presses", STABLE, 0.03, "made more than without", coefficient,
     2},
    {FRICTION, "friction-2.5", "friction above any sense", REFUSED, 0, "", coefficient, 2.5},
    {FRICTION, "friction-no-skin", "friction, tools without skin", STABLE, 0.03, "made more than without", skin, 0},
    {FRICTION, "friction-soft-skin", "friction, skin a hundred times as soft", STABLE, 0.03, "made more than without",
     skin, 0.05},
    {FRICTION, "friction-pause", "friction, held still inside its cone for two minutes", ACCURATE, 1e-6, "crept, N",
     pause_for, 2},
};
const int cases_friction_count = sizeof cases_friction / sizeof *cases_friction;
