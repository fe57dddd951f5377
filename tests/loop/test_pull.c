/* A grasper grasps, pulls, drags and releases: every extrapolator on samples of 20 Hz against the same simulation at
 * every tick. */
#include "held_patch.h"
#include "internal.h"
#include "rig.h"

#include "../physics/contact_scene.h"

enum { TICKS = 1400, EVERY = 25, LAWS = 3 }; /* of 2 ms; a sample every 50 ms */
static const hrt_extrapolator laws[LAWS] = {HRT_POSITION, HRT_TANGENT, HRT_LOCAL_MODEL};

static double stroke(double t, double from, double to) { /* minimum jerk */
    const double s = fmin(fmax((t - from) / (to - from), 0.0), 1.0);
    return s * s * s * (10.0 + s * (6.0 * s - 15.0));
}

/* Moves down 1 mm into the surface, closes, pulls up 7 mm and aside, drags back, pulls again; the hand trembles. */
static tm_tool_pose hand(double t) {
    const double pull = stroke(t, 0.4, 1.2) - 0.6 * stroke(t, 1.3, 1.8) + 0.4 * stroke(t, 2.0, 2.5);
    const double tremor = 40e-6 * sin(2.0 * 3.14159265358979 * 9.0 * t);
    tm_tool_pose at = scene_pose(0.008 + 0.005 * stroke(t, 0.9, 1.6) + tremor, 0.004 - 0.004 * stroke(t, 1.6, 2.4),
                                 0.0447 - 0.001 * stroke(t, 0.0, 0.2) + 0.007 * pull + tremor);
    at.grip = t > 0.25 ? 1.0 : 0.0;
    return at;
}

typedef struct run {
    hrt_extrapolation x;
    double square;
} run;

static void give(run *r, const hrt_params *params, const tm_tool_reaction *is, const double trocar_m[3], int tick,
                 const hrt_patch *patch) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = TICK_US * tick, .seq = (uint32_t)tick + 1u};
    s.stiffness_kind = is->stiffness_kind;
    s.patch = patch;
    for (int i = 0; i < 3; i++) {
        s.tip_m[i] = (float)(is->tip_m[i] - trocar_m[i]);
        s.force_N[i] = (float)is->force_N[i];
    }
    for (int i = 0; i < 9; i++) s.stiffness_N_m[i] = (float)is->stiffness_N_m[i];
    if (patch) s.topology_revision = patch->topology_revision;
    hrt_extrapolation_sample(&r->x, params, &s);
}

static void pulling_force_follows_the_simulation_at_every_tick(void **state) {
    (void)state;
    static const tm_tool_mode mode[2] = {TM_TOOL_GRASPER, TM_TOOL_GRASPER};
    static hrt_patch patches[2];
    static run runs[LAWS];
    static tm_patch made;
    static float scratch[HRT_PATCH_COMPLIANCE];
    hrt_params params;
    tm_error error;
    tm_patch_builder *maker;
    tm_grasp *grasp;
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 8, d.cells[2] = 4;
    d.damping_1_s = 60;
    d.trocar_m[0][0] = 0.1;
    memcpy(d.tip_m[0], (double[3]){0.008, 0.004, 0.0447}, sizeof d.tip_m[0]);
    scene s = scene_create_full(&d, false, mode);
    tm_grasp_def grasp_def = tm_grasp_def_default();
    tm_patch_def def = tm_patch_def_default();
    def.tolerance = 1e-6;
    scene_must(tm_stage_grasp(s.world, s.contact, &grasp_def, &grasp, &error), &error);
    scene_must(tm_stage_patch(s.world, s.contact, &def, &maker, &error), &error);
    hrt_params_default(&params);
    for (int w = 0; w < LAWS; w++) hrt_extrapolation_reset(&runs[w].x, laws[w]);
    double peak = 0.0;
    int judged = 0, off = 0, patched = 0;
    for (int t = 0; t < TICKS; t++) {
        const tm_tool_pose at = hand(2e-3 * t);
        tm_tool_reaction is = scene_frame(&s, 0, at, 2e-3);
        if (t % EVERY == 0) {
            bool whole = tm_patch_compute(maker, 0, &made);
            for (int k = 0; k < 500 && tm_patch_pending(maker) > 0; k++) whole = tm_patch_compute(maker, 0, &made);
            const tm_tool_reaction felt = tm_contact_reaction(s.contact, 0);
            hrt_patch *patch = &patches[t / EVERY % 2];
            if (whole) patch_to_controller(&made, patch);
            if (whole) assert_int_equal(hrt_patch_prepare(patch, scratch), HRT_ACCEPT);
            patched += whole && made.grasps;
            for (int w = 0; w < LAWS; w++) give(&runs[w], &params, &felt, s.def.trocar_m[0], t, whole ? patch : NULL);
        }
        float tip[3], force[3];
        for (int i = 0; i < 3; i++) tip[i] = (float)(at.tip_m[i] - s.def.trocar_m[0][i]);
        double size = 0.0;
        for (int w = 0; w < LAWS; w++) {
            hrt_extrapolation_force(&runs[w].x, &params, TICK_US * t, tip, force);
            for (int i = 0; i < 3 && t >= 200; i++) runs[w].square += pow((double)force[i] - is.force_N[i], 2);
            off += w == LAWS - 1 && t >= 200 && (runs[w].x.limits & HRT_LIMIT_PATCH) != 0;
        }
        for (int i = 0; i < 3; i++) size += is.force_N[i] * is.force_N[i];
        peak = fmax(peak, sqrt(size));
        judged += t >= 200;
    }
    double rms[LAWS];
    for (int w = 0; w < LAWS; w++) rms[w] = sqrt(runs[w].square / judged) / peak;
    print_message(
        "pulled with up to %.2f N: RMS over the peak: position %.3f %%, tangent %.3f %%, contact %.3f %%; %d patches "
        "with a hold, %d ticks off them\n",
        peak, 100.0 * rms[0], 100.0 * rms[1], 100.0 * rms[2], patched, off);
    assert_true(peak > 0.5 && patched >= (TICKS - 200) / EVERY && off == 0);
    /* The remaining error is the mass that moves with the hand, which a patch does not have: docs/extrapolation.md. */
    assert_true(rms[2] < 0.35 * rms[0] && rms[1] < 0.35 * rms[0] && rms[2] < 0.0035);
    scene_destroy(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(pulling_force_follows_the_simulation_at_every_tick)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
