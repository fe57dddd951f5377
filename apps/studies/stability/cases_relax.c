/* Tissue that relaxes under load: a grasper pulls it up and a probe nearby is pressed in and pushed sideways within its
 * friction cone. Both are held while the moduli fall to a fifth. The forces must reach those on tissue of the relaxed
 * moduli after the same motion. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"

enum { TOOLS = RIG_TOOLS, GRASPER = 0, PROBE = 1 };
#define TOP_M 0.04
static const double FRAME_S = 0.005, RADIUS_M = 0.0025, LEFT = 0.2;

typedef struct hold {
    rig r;
    double over_cone;
    bool finite, slips;
} hold;

static bool open_hold(hold *h, bool relaxes, double rotation, outcome *o) {
    static const tm_tool_pose start[TOOLS] = {{.tip_m = {0.012, 0.02, TOP_M + 0.003}, .active = true},
                                              {.tip_m = {0.028, 0.02, TOP_M + 0.003}, .active = true}};
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    tm_friction_def friction = tm_friction_def_default();
    rig_def def = rig_default(TOOLS, start);
    *h = (hold){.finite = true};
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.4, 0.4}, viscosity.term[1] = (tm_viscosity_term){0.4, 0.4, 0.4};
    if (relaxes) def.bench.viscosity = &viscosity;
    if (!relaxes && tm_material_young(LEFT * 5e3, 0.45, &def.bench.material[0], NULL) != TM_OK) abort();
    def.bench.material[0].damping_1_s = 60, def.bench.rotation = rotation;
    friction.instrument[PROBE] = (tm_friction_coefficient){0.6, 0.5};
    def.tool[GRASPER].mode = TM_TOOL_GRASPER, def.jaws = true, def.friction = &friction;
    return rig_open(&def, &h->r, "N on the grasper", o);
}

static void frame(hold *h) {
    rig_frame(&h->r, FRAME_S, 1);
    h->slips = false;
    h->over_cone = fmax(h->over_cone, rig_over_cone(&h->r, PROBE, &h->slips, NULL, NULL));
    h->finite = h->finite && h->r.finite;
    for (int c = 0; c < 3 * TOOLS; c++) h->finite = h->finite && fabs(h->r.force_N[c / 3][c % 3]) < 100;
}

/* Both tools descend; the jaws close; up and sideways within a second. The probe goes deeper as it moves sideways. */
static void read_hold(hold *h) {
    for (int i = 1; i <= 40; i++) {
        h->r.at[GRASPER].tip_m[2] = TOP_M + RADIUS_M - 0.0005 * i / 40;
        h->r.at[PROBE].tip_m[2] = TOP_M + RADIUS_M - 0.003 * i / 40;
        frame(h);
    }
    for (int i = 0; i < 40; i++) h->r.at[GRASPER].grip = fmin(1, i / 20.0), frame(h);
    for (int i = 1; i <= 100; i++) {
        h->r.at[GRASPER].tip_m[2] = TOP_M + RADIUS_M - 0.0005 + 0.006 * i / 100;
        h->r.at[PROBE].tip_m[0] = 0.028 + 0.001 * i / 100;
        frame(h);
    }
}

static double pull_N(const hold *h) {
    return sqrt(pow(h->r.force_N[0][0], 2) + pow(h->r.force_N[0][1], 2) + pow(h->r.force_N[0][2], 2));
}

static double force_difference(const hold *is, const hold *truth) {
    double off = 0, most = 0;
    for (int t = 0; t < TOOLS; t++)
        for (int c = 0; c < 3; c++) {
            off = fmax(off, fabs(is->r.force_N[t][c] - truth->r.force_N[t][c]));
            most = fmax(most, fabs(truth->r.force_N[t][c]));
        }
    return off / most;
}

static void relax(bool quick, double rotation, outcome *o) {
    hold h, truth;
    outcome ignored = {0};
    const int frames = (int)((quick ? 6 : 30) / FRAME_S);
    if (!open_hold(&truth, false, rotation, o)) return;
    read_hold(&truth);
    for (int i = 0; i < 400; i++) frame(&truth);
    if (!open_hold(&h, true, rotation, &ignored)) {
        app_bench_close(&truth.r.b);
        *o = ignored;
        return;
    }
    read_hold(&h);
    const double first = pull_N(&h);
    double last = first, rise = 0;
    for (int i = 0; i < frames && h.finite; i++) {
        frame(&h);
        if (i >= 20) rise = fmax(rise, pull_N(&h) - last); /* the oscillation of the pull has decayed */
        last = pull_N(&h);
        if (i % (frames / 200) == 0) series_add(o, tm_world_state(h.r.b.world)->time_s, last);
    }
    tm_grasp_state state;
    const int32_t held = tm_grasp_vertices(h.r.grasp, GRASPER, NULL, &state);
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
    app_bench_close(&h.r.b);
    app_bench_close(&truth.r.b);
}

#define VISCOSITY "viscosity"
const hard_case cases_relax[] = {
    {VISCOSITY, "viscosity-held", "grasped, and rubbed within the cone, held while four fifths of it relax", ACCURATE,
     0.02, "force, of the relaxed", relax, 0},
    {VISCOSITY, "viscosity-held-rotation", "the same with rotation", ACCURATE, 0.02, "force, of the relaxed", relax,
     TM_ROTATION_THRESHOLD},
};
const int cases_relax_count = sizeof cases_relax / sizeof *cases_relax;
