/* Tissue that relaxes in the instruments' hold: a grasper pulls it up, a probe beside it is pressed in and pushed aside
 * within its cone of friction, and both are held while the moduli fall to a fifth. Where forces come to lie is where
 * those on tissue of the relaxed moduli do that went the same way. */
#include <math.h>
#include <string.h>

#include "stability.h"

enum { TOOLS = 2, GRASPER = 0, PROBE = 1 };
static const double TOP_M = 0.04, FRAME_S = 0.005, RADIUS_M = 0.0025, LEFT = 0.2;

typedef struct hold {
    bench b;
    tm_contact *contact;
    tm_grasp *grasp;
    tm_friction *friction;
    tm_tool_pose at[TOOLS];
    double force_N[TOOLS][3], over_cone;
    bool finite, slips;
} hold;

static bool open_hold(hold *h, bool relaxes, double rotation, outcome *o) {
    bench_def def = bench_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    tm_error error = {0};
    *h = (hold){.finite = true};
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.4, 0.4}, viscosity.term[1] = (tm_viscosity_term){0.4, 0.4, 0.4};
    if (relaxes) def.viscosity = &viscosity;
    if (!relaxes && tm_material_young(LEFT * 5e3, 0.45, &def.material[0], &error) != TM_OK) {
        refused(o, &error);
        return false;
    }
    def.material[0].damping_1_s = 60, def.rotation = rotation;
    if (!bench_open(&def, &h->b, o)) return false;
    tm_instrument_def tool[TOOLS];
    for (int t = 0; t < TOOLS; t++) {
        const double x = 0.012 + 0.016 * t;
        h->at[t] = (tm_tool_pose){.tip_m = {x, 0.02, TOP_M + 0.003}, .active = true};
        tool[t] = (tm_instrument_def){.mode = t == GRASPER ? TM_TOOL_GRASPER : TM_TOOL_PROBE,
                                      .radius_m = RADIUS_M,
                                      .contact_length_m = 0.1,
                                      .trocar_m = {x, 0.02, 0.2},
                                      .pose = h->at[t]};
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = TOOLS, contact.instrument = tool;
    const tm_grasp_def grasp = tm_grasp_def_default();
    tm_friction_def friction = tm_friction_def_default();
    friction.instrument[PROBE] = (tm_friction_coefficient){0.6, 0.5};
    if (tm_stage_contact(h->b.world, &contact, &h->contact, &error) == TM_OK &&
        tm_stage_grasp(h->b.world, h->contact, &grasp, &h->grasp, &error) == TM_OK &&
        tm_stage_friction(h->b.world, h->contact, &friction, &h->friction, &error) == TM_OK)
        return true;
    bench_close(&h->b);
    refused(o, &error);
    return false;
}

static void frame(hold *h) {
    const int32_t n = (int32_t)ceil(FRAME_S / tm_world_step_s(h->b.world));
    tm_contact_begin_frame(h->contact, n, 1);
    for (int t = 0; t < TOOLS; t++) tm_contact_move(h->contact, t, h->at + t, n);
    h->finite = h->finite && tm_world_step(h->b.world, n) == TM_OK;
    for (int t = 0; t < TOOLS; t++) {
        memcpy(h->force_N[t], tm_contact_reaction(h->contact, t).force_N, sizeof h->force_N[t]);
        for (int c = 0; c < 3; c++) h->finite = h->finite && fabs(h->force_N[t][c]) < 100;
    }
    tm_friction_grip grip[16];
    const int32_t there = tm_friction_grips(h->friction, PROBE, grip, 16);
    h->slips = false;
    for (int32_t i = 0; i < there && i < 16; i++) {
        const double *f = grip[i].force_N, size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        h->over_cone = fmax(h->over_cone, size / grip[i].pressed_N - grip[i].coefficient);
        h->slips = h->slips || grip[i].slips;
    }
}

/* Both down; the jaws close; up and aside within a second. The probe goes in further as it goes aside. */
static void take_hold(hold *h) {
    for (int i = 1; i <= 40; i++) {
        h->at[GRASPER].tip_m[2] = TOP_M + RADIUS_M - 0.0005 * i / 40;
        h->at[PROBE].tip_m[2] = TOP_M + RADIUS_M - 0.003 * i / 40;
        frame(h);
    }
    for (int i = 0; i < 40; i++) h->at[GRASPER].grip = fmin(1, i / 20.0), frame(h);
    for (int i = 1; i <= 100; i++) {
        h->at[GRASPER].tip_m[2] = TOP_M + RADIUS_M - 0.0005 + 0.006 * i / 100;
        h->at[PROBE].tip_m[0] = 0.028 + 0.001 * i / 100;
        frame(h);
    }
}

static double pull_N(const hold *h) {
    return sqrt(pow(h->force_N[0][0], 2) + pow(h->force_N[0][1], 2) + pow(h->force_N[0][2], 2));
}

static double force_difference(const hold *is, const hold *truth) {
    double off = 0, most = 0;
    for (int t = 0; t < TOOLS; t++)
        for (int c = 0; c < 3; c++) {
            off = fmax(off, fabs(is->force_N[t][c] - truth->force_N[t][c]));
            most = fmax(most, fabs(truth->force_N[t][c]));
        }
    return off / most;
}

static void relax(bool quick, double rotation, outcome *o) {
    hold h, truth;
    outcome ignored = {0};
    const int frames = (int)((quick ? 6 : 30) / FRAME_S);
    if (!open_hold(&truth, false, rotation, o)) return;
    take_hold(&truth);
    for (int i = 0; i < 400; i++) frame(&truth);
    if (!open_hold(&h, true, rotation, &ignored)) {
        bench_close(&truth.b);
        *o = ignored;
        return;
    }
    o->x_name = "simulated s", o->y_name = "N on the grasper";
    take_hold(&h);
    const double first = pull_N(&h);
    double last = first, rise = 0;
    for (int i = 0; i < frames && h.finite; i++) {
        frame(&h);
        if (i >= 20) rise = fmax(rise, pull_N(&h) - last); /* the pull's own swing is over */
        last = pull_N(&h);
        if (i % (frames / 200) == 0) series_add(o, tm_world_state(h.b.world)->time_s, last);
    }
    tm_grasp_state state;
    const int32_t held = tm_grasp_held(h.grasp, GRASPER, NULL, &state);
    const double off = force_difference(&h, &truth);
    if (!h.finite || !truth.finite)
        broken(o, "a step failed or a force grew");
    else if (held < 3 || state != TM_GRASP_HOLDING || h.over_cone > 1e-6 || h.slips)
        broken(o, "%d vertices held; %.1e over the cone; %s", held, h.over_cone, h.slips ? "slips" : "sticks");
    else if (rise > 1e-6 * first)
        broken(o, "the pull rose by %.2g N while the tissue relaxed", rise);
    else
        accurate(o, off,
                 "%d vertices held: %.3f N fell to %.4f in %d s, never rising by more than %.1e; both tools' forces "
                 "are %.1e of the largest from those on tissue of the relaxed moduli",
                 held, first, last, (int)(frames * FRAME_S), rise, off);
    bench_close(&h.b);
    bench_close(&truth.b);
}

#define VISCOSITY "viscosity"
const hard_case cases_relax[] = {
    {VISCOSITY, "viscosity-held", "grasped, and rubbed within the cone, held while four fifths of it relax", ACCURATE,
     0.02, "force, of the relaxed", relax, 0},
    {VISCOSITY, "viscosity-held-rotation", "the same with rotation", ACCURATE, 0.02, "force, of the relaxed", relax,
     TM_ROTATION_THRESHOLD},
};
const int cases_relax_count = sizeof cases_relax / sizeof *cases_relax;
