/* Friction: coefficients beyond any real value, a step without contact compliance, a hand that shakes faster than
 * frames. Two tools drag the tissue between them; a tool rests inside the cone for minutes. */
#include <math.h>
#include <stdlib.h>

#include "stability.h"

enum { TOOLS = RIG_TOOLS };
#define TOP_M 0.04
static const double FRAME_S = 0.005, RADIUS_M = 0.0025;

typedef struct friction_scene {
    rig r;
    double over_cone, peak_N, hands_J, generated_J;
} friction_scene;

static bool open_scene(friction_scene *x, double at_rest, double sliding, double row_compliance_m_N, outcome *o) {
    static const tm_tool_pose start[TOOLS] = {{.tip_m = {0.012, 0.02, TOP_M + 0.003}, .active = true},
                                              {.tip_m = {0.028, 0.02, TOP_M + 0.003}, .active = true}};
    tm_friction_def friction = tm_friction_def_default();
    rig_def def = rig_default(TOOLS, start);
    *x = (friction_scene){.over_cone = 0};
    for (int t = 0; t < TOOLS; t++) friction.instrument[t] = (tm_friction_coefficient){at_rest, sliding};
    def.bench.material[0].damping_1_s = 60, def.row_compliance_m_N = row_compliance_m_N, def.energy = true;
    if (at_rest > 0) def.friction = &friction;
    return rig_open(&def, &x->r, "force along the surface over what presses", o);
}

/* Moves tools by x[t] sideways from their start, `deep` into the surface. */
static void frame(friction_scene *x, const double x_m[TOOLS], double deep_m) {
    rig *r = &x->r;
    tm_energy e;
    for (int t = 0; t < TOOLS; t++)
        r->at[t] =
            (tm_tool_pose){.tip_m = {0.012 + 0.016 * t + x_m[t], 0.02, TOP_M + RADIUS_M - deep_m}, .active = true};
    rig_frame(r, FRAME_S, 1);
    if (tm_world_energy(r->b.world, &e, NULL) == TM_OK) {
        x->hands_J = fmax(x->hands_J, fabs(e.tool_work_J[0]) + fabs(e.tool_work_J[1]));
        x->generated_J = fmax(x->generated_J, e.generated_J);
    }
    for (int t = 0; t < TOOLS; t++) {
        const double *f = r->force_N[t];
        double along_N = 0, normal_force_N = 0;
        x->peak_N = fmax(x->peak_N, fabs(f[0]) + fabs(f[1]) + fabs(f[2]));
        x->over_cone = fmax(x->over_cone, rig_over_cone(r, t, NULL, &along_N, &normal_force_N));
        if (t == 0 && normal_force_N > 0)
            series_add(r->o, tm_world_state(r->b.world)->time_s, along_N / normal_force_N);
    }
}

static void press_in(friction_scene *r, double deep_m) {
    for (int i = 1; i <= 40; i++) frame(r, (double[TOOLS]){0, 0}, deep_m * i / 40);
}

/* Moves the tools to and fro at 20 Hz in opposite directions; the tissue between them is dragged both ways. */
static void drags(friction_scene *r, bool quick) {
    press_in(r, 0.003);
    for (int i = 0; i < (quick ? 120 : 1200); i++) {
        const double x = 0.004 * sin(0.63 * i);
        frame(r, (double[TOOLS]){x, -x}, 0.003);
    }
}

/* Judges: no force is outside its cone, and contact generates no more energy than without friction, as a share of the
 * hands' work. (Facets of four tool radii and viscous contact drag at 0.5 m/s generate some.) */
static void judge(double at_rest, double sliding, double row_compliance_m_N, bool quick, outcome *o) {
    friction_scene r, plain;
    outcome ignored = {0};
    if (!open_scene(&r, at_rest, sliding, row_compliance_m_N, o)) return;
    drags(&r, quick);
    app_bench_close(&r.r.b);
    if (!open_scene(&plain, 0, 0, row_compliance_m_N, &ignored)) abort();
    drags(&plain, quick);
    app_bench_close(&plain.r.b);
    const double made = (r.generated_J - plain.generated_J) / r.hands_J;
    if (!r.r.finite || !(r.peak_N < 200))
        broken(o, "%s, %.3g N", r.r.finite ? "the force grew" : "a step failed", r.peak_N);
    else if (r.over_cone > 1e-6)
        broken(o, "a force is outside its cone by %.1e of what presses", r.over_cone);
    else
        stable(
            o, fmax(made, 0),
            "two tools shaken at 20 Hz: at most %.2f N, no force outside its cone, contact made %.2e J (%.2e without "
            "friction) of the hands' %.2e",
            r.peak_N, r.generated_J, plain.generated_J, r.hands_J);
}

static void coefficient(bool quick, double at_rest, outcome *o) {
    judge(at_rest, at_rest < 1 ? 0.5 * at_rest : at_rest, 0.5e-3, quick, o);
}

static void compliant(bool quick, double row_compliance_m_N, outcome *o) {
    judge(0.4, 0.3, row_compliance_m_N, quick, o);
}

/* Compares the force of a tool held still inside its cone with that minutes later. */
static void pause_for(bool quick, double minutes, outcome *o) {
    friction_scene r;
    if (!open_scene(&r, 0.5, 0.4, 0.5e-3, o)) return;
    double x[TOOLS] = {0, 0};
    press_in(&r, 0.003);
    for (int i = 0; i < 40; i++) x[0] += 2e-5, frame(&r, x, 0.003);
    for (int i = 0; i < 300; i++) frame(&r, x, 0.003);
    const tm_tool_reaction was = tm_contact_reaction(r.r.contact, 0);
    const int frames = (int)(60 * (quick ? 0.05 : minutes) / FRAME_S);
    for (int i = 0; i < frames; i++) frame(&r, x, 0.003);
    const tm_tool_reaction is = tm_contact_reaction(r.r.contact, 0);
    double crept = 0;
    for (int c = 0; c < 3; c++) crept = fmax(crept, fabs(is.force_N[c] - was.force_N[c]));
    if (r.r.finite && fabs(was.force_N[0]) > 0.01)
        accurate(o, crept, "held with %.3f N aside, %.2g N of it gone after %.3g min", fabs(was.force_N[0]), crept,
                 frames * FRAME_S / 60);
    else
        broken(o, "it does not hold: %.3g N aside", was.force_N[0]);
    app_bench_close(&r.r.b);
}

#define FRICTION "tool"
const hard_case cases_friction[] = {
    {FRICTION, "friction-0.3", "friction, 0.3 at rest and half of it sliding", STABLE, 0.03, "made more than without",
     coefficient, 0.3},
    {FRICTION, "friction-2", "friction, 2.0: twice what presses", STABLE, 0.03, "made more than without", coefficient,
     2},
    {FRICTION, "friction-2.5", "friction above any sense", REFUSED, 0, "", coefficient, 2.5},
    {FRICTION, "friction-no-compliance", "friction, rigid contact", STABLE, 0.03, "made more than without", compliant,
     0},
    {FRICTION, "friction-soft-compliance", "friction, contact a hundred times as soft", STABLE, 0.03,
     "made more than without", compliant, 0.05},
    {FRICTION, "friction-pause", "friction, held still inside its cone for two minutes", ACCURATE, 1e-6, "crept, N",
     pause_for, 2},
};
const int cases_friction_count = sizeof cases_friction / sizeof *cases_friction;
