/* Energy balance: closed to rounding without frictional tools, and bounded additions by contact, jaws and cuts. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"

static double throughput(const tm_energy *e) {
    double sum = e->start_J + fabs(e->support_J) + fabs(e->gravity_J) + fabs(e->load_J) + fabs(e->state_change_J) +
                 e->damping_J + fabs(e->cut_J);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) sum += fabs(e->contact_J[t]) + fabs(e->grasp_J[t]);
    return sum;
}

/* --- without tools --- */

typedef enum motion { SWING, DAMPED, WEIGHT, MOVING_SUPPORT, NEW_STEPS, CUTS } motion;

static void one_motion(app_bench *b, motion which, int64_t i, double longest_s, uint64_t *seed) {
    const int32_t held = 3 * 25; /* the bottom layer of the default bench */
    if (which == MOVING_SUPPORT)
        for (int32_t k = 0; k < held; k += 3) tm_support_move(b->world, k, 0.002 * sin(0.05 * (double)i));
    if (which == NEW_STEPS) tm_world_set_step(b->world, longest_s * (0.55 + 0.4 * random_unit(seed)), NULL);
    if (which == CUTS && i % 20 == 0) {
        const int32_t tet = (int32_t)(0.5 * (1 + random_unit(seed)) * (b->mesh->tet_count - 1));
        tm_cut_remove(b->tissue, &tet, 1, NULL, 0);
    }
}

static void closes(bool quick, double argument, outcome *o) {
    const motion which = (motion)(int)argument;
    app_bench_def def = bench_default();
    app_bench b;
    tm_energy e = {0};
    def.cuttable = which == CUTS;
    def.material[0].damping_1_s = which == SWING ? 0 : which == NEW_STEPS || which == CUTS ? 1 : 20;
    if (!bench_open(&def, &b, o)) return;
    const double longest_s = tm_critical_step_guaranteed(b.tissue, NULL);
    uint64_t seed = 5;
    tm_status status = TM_OK;
    if (which == WEIGHT) status = tm_stage_gravity(b.world, (const double[3]){1, 0, -9.81}, NULL);
    if (status == TM_OK) status = tm_stage_energy(b.world, NULL);
    random_velocities(&b, 11, 0.1);
    double worst = 0;
    o->x_name = "simulated s", o->y_name = "stored J";
    for (int64_t i = 0, n = quick ? 1000 : 10000; i < n && status == TM_OK; i++) {
        one_motion(&b, which, i, longest_s, &seed);
        status = tm_world_step(b.world, 10);
        if (status == TM_OK) status = tm_world_energy(b.world, &e, NULL);
        worst = fmax(worst, fabs(e.residual_J) / throughput(&e));
        if (i % (n / 200) == 0) series_add(o, e.time_s, e.kinetic_J + e.elastic_J);
    }
    if (status == TM_OK)
        accurate(o, worst,
                 "%.2e J went round: supports %+.1e, weight %+.1e, damping took %.1e, cuts %.1e, new steps %+.1e; off "
                 "by %.1e of it at most",
                 throughput(&e), e.support_J, e.gravity_J, e.damping_J, e.cut_J, e.state_change_J, worst);
    else
        broken(o, "the run became unstable");
    app_bench_close(&b);
}

/* --- with tools --- */

static const double TOP_M = 0.04;

typedef struct hands {
    rig r;
    tm_energy now, before;
    double through_J, excess_J, residual; /* work of the hands; maximum excess of tissue and springs over it */
} hands;

static bool hands_open(hands *h, tm_tool_mode other, outcome *o) {
    static const tm_tool_pose start[2] = {{.tip_m = {0.022, 0.02, 0.05}, .active = true},
                                          {.tip_m = {0.016, 0.02, 0.06}, .active = true}};
    rig_def def = rig_default(2, start);
    memset(h, 0, sizeof *h);
    def.bench.cells[0] = def.bench.cells[1] = def.bench.cells[2] = 8;
    def.bench.material[0].damping_1_s = 40, def.bench.cuttable = def.jaws = def.energy = true;
    def.tool[0].mode = TM_TOOL_GRASPER, def.tool[0].trocar_m[0] = 0.12;
    def.tool[1].mode = other, def.tool[1].trocar_m[0] = -0.08;
    def.tool[1].pose.active = other != TM_TOOL_CAUTERY;
    return rig_open(&def, &h->r, "surplus J", o);
}

/* Moves both tools to their targets in frames of 10 ms. */
static void go(hands *h, tm_tool_pose first, tm_tool_pose second, int frames) {
    rig *r = &h->r;
    const tm_tool_pose from[2] = {r->at[0], r->at[1]}, to[2] = {first, second};
    for (int k = 1; k <= frames && r->finite; k++) {
        rig_lead(r, from, to, k, frames);
        h->before = h->now;
        rig_frame(r, 0.01, 4);
        r->finite = r->finite && tm_world_energy(r->b.world, &h->now, NULL) == TM_OK;
        for (int t = 0; t < 2; t++) h->through_J += fabs(h->now.tool_work_J[t] - h->before.tool_work_J[t]);
        h->excess_J = fmax(h->excess_J, h->now.generated_J - h->now.drag_J);
        h->residual = fmax(h->residual, fabs(h->now.residual_J) / (throughput(&h->now) + 1e-12));
        series_add(r->o, h->now.time_s, h->now.generated_J - h->now.drag_J);
    }
}

static void hands_close(hands *h, const char *words) {
    if (!h->r.finite || h->residual > 1e-9)
        broken(h->r.o, "%s: %s", words, h->r.finite ? "the tissue's side does not close" : "unstable");
    else
        stable(h->r.o, h->excess_J / h->through_J,
               "%s: %.2e J went through the hands, tissue and springs had %.1e J more than that at most, drag took "
               "%.1e J, cuts %.1e J",
               words, h->through_J, h->excess_J, h->now.drag_J, h->now.cut_J);
    app_bench_close(&h->r.b);
}

static tm_tool_pose at(double x, double z, double grip) {
    return (tm_tool_pose){.tip_m = {x, 0.02, z}, .grip = grip, .active = true};
}
static const tm_tool_pose away = {.tip_m = {-0.02, 0.02, 0.06}, .active = true};

typedef enum action { PRESS, SLIDE, HOLD, RELEASE, RELEASE_UNDER, HAND_OVER, CUT_HELD } action;

static void actions(bool quick, double argument, outcome *o) {
    (void)quick;
    static const char *const words[] = {"pressed and left",          "pressed and slid",
                                        "held, lifted and put back", "held, lifted and let go",
                                        "let go under a probe",      "handed from one grasper to the other",
                                        "cut while held up"};
    static const tm_tool_mode other[] = {TM_TOOL_PROBE, TM_TOOL_PROBE,   TM_TOOL_PROBE,  TM_TOOL_PROBE,
                                         TM_TOOL_PROBE, TM_TOOL_GRASPER, TM_TOOL_CAUTERY};
    const action which = (action)(int)argument;
    hands h;
    if (!hands_open(&h, other[which], o)) return;
    tm_tool_pose aside = away;
    aside.active = which != CUT_HELD;
    go(&h, at(0.022, TOP_M + 0.006, 0), aside, 5);
    go(&h, at(0.022, TOP_M + (which == PRESS || which == SLIDE ? -0.004 : 0.001), 0), aside, 20);
    if (which == SLIDE) go(&h, at(0.032, TOP_M - 0.004, 0), aside, 30);
    if (which >= HOLD) {
        go(&h, at(0.022, TOP_M + 0.001, 1), aside, 2);
        go(&h, at(0.022, TOP_M + 0.006, 1), aside, 20);
    }
    if (which == HOLD) go(&h, at(0.022, TOP_M + 0.001, 1), aside, 20);
    if (which == RELEASE_UNDER) {
        go(&h, h.r.at[0], at(0.019, TOP_M + 0.011, 0), 10);
        go(&h, h.r.at[0], at(0.019, TOP_M + 0.002, 0), 20);
    }
    if (which == HAND_OVER) {
        go(&h, h.r.at[0], at(0.020, TOP_M + 0.006, 0), 20);
        go(&h, h.r.at[0], at(0.020, TOP_M + 0.006, 1), 4);
    }
    if (which == CUT_HELD) go(&h, h.r.at[0], at(0.014, TOP_M - 0.002, 0), 30);
    tm_tool_pose open = h.r.at[0];
    open.grip = 0;
    go(&h, open, h.r.at[1], 30); /* release */
    go(&h, at(0.022, TOP_M + 0.02, 0), h.r.at[1], 20);
    go(&h, h.r.at[0], at(-0.02, TOP_M + 0.02, 0), 40);
    hands_close(&h, words[which]);
}

#define ENERGY "energy"
#define OFF "off, share of what went round"
#define GENERATED_MAX "surplus, share of what went through the hands"
const hard_case cases_energy[] = {
    {ENERGY, "energy-swing", "a free swing, undamped", ACCURATE, 1e-11, OFF, closes, SWING},
    {ENERGY, "energy-damped", "a damped swing", ACCURATE, 1e-11, OFF, closes, DAMPED},
    {ENERGY, "energy-weight", "gravity, let fall at once", ACCURATE, 1e-11, OFF, closes, WEIGHT},
    {ENERGY, "energy-support", "a support shaken sideways", ACCURATE, 1e-11, OFF, closes, MOVING_SUPPORT},
    {ENERGY, "energy-steps", "a new step every ten", ACCURATE, 1e-11, OFF, closes, NEW_STEPS},
    {ENERGY, "energy-cuts", "tetrahedra cut out of a swing", ACCURATE, 1e-11, OFF, closes, CUTS},
    {ENERGY, "energy-press", "pressed and left", STABLE, 0.02, GENERATED_MAX, actions, PRESS},
    {ENERGY, "energy-slide", "pressed and slid", STABLE, 0.02, GENERATED_MAX, actions, SLIDE},
    {ENERGY, "energy-hold", "held, lifted, put back", STABLE, 0.02, GENERATED_MAX, actions, HOLD},
    {ENERGY, "energy-release", "held, lifted, let go", STABLE, 0.02, GENERATED_MAX, actions, RELEASE},
    {ENERGY, "energy-release-under", "let go while a probe bears on it", STABLE, 0.02, GENERATED_MAX, actions,
     RELEASE_UNDER},
    {ENERGY, "energy-hand-over", "from one grasper to the other", STABLE, 0.02, GENERATED_MAX, actions, HAND_OVER},
    {ENERGY, "energy-cut-held", "cut while held up", STABLE, 0.02, GENERATED_MAX, actions, CUT_HELD},
};
const int cases_energy_count = sizeof cases_energy / sizeof *cases_energy;
