/* Checks stiffness and patch against later samples: agreement of the predicted force, and its drift without motion. */
#include "internal.h"

#if HRT_WITH_EVIDENCE

/* Squared force changes below this are unreliable evidence. */
static const float UNRELIABLE_N2 = 1.0e-4f;

/* Returns the share of a received stiffness's predictions that recent samples confirmed. Tissue that is cut repeatedly
 * never reaches the equilibrium that the stiffness assumes. Directly after a cut only the measured share counts. */
float hrt_evidence_trust(const hrt_extrapolation *x) {
    const float unseen_N2 = x->cut ? 0.0f : UNRELIABLE_N2;
    return hrt_clamp((x->came_N2 + unseen_N2) / (x->foretold_N2 + UNRELIABLE_N2), 0.0f, 1.0f);
}

/* Updates predicted and actual force changes for the previous sample's stiffness; they decay by half per sample. */
void hrt_evidence_judge(hrt_extrapolation *x) {
    float step[3], change[3], foretold[3];
    vsub(x->now.tip_m, x->previous.tip_m, step);
    vsub(x->now.force_N, x->previous.force_N, change);
    hrt_apply(x->previous.stiffness_N_m, step, foretold);
    const bool known = vnorm(x->now.force_N) + vnorm(x->previous.force_N) > 0.0f;
    x->foretold_N2 = known ? 0.5f * x->foretold_N2 + vdot(foretold, foretold) : 0.0f;
    x->came_N2 = known ? 0.5f * x->came_N2 + vdot(change, foretold) : 0.0f;
}

/* Maximum drift, as a share of the patch's force. */
static const float DRIFT_MAX = 0.2f;
/* Drifts measured over less time are averaged. */
static const float DRIFT_S = 0.015f;
static const float DRIFT_FORGOTTEN = 0.5f;

/* Returns whether the patch reproduces its sample's force, within a half. A patch does not if a cautery touches the
 * inside of its cut. Used only while cutting: otherwise a patch that differs has only crossed an edge before the
 * tissue, and soon agrees again. Dropping it would lose it for a complete interval. */
static bool agrees(const hrt_extrapolation *x) {
    hrt_touch trial = x->touch;
    float force[3], miss[3];
    if (!(vnorm(x->now.force_N) > 0.0f)) return true;
    vset(x->now.tip_m, trial.drag_tip_m);
    for (int i = 0; i < 3; i++) trial.mean_m_s[i] = 0.0f;
    if (!hrt_contact_force(x->patch, &trial, trial.drag_us, x->now.tip_m, force)) return false;
    vsub(force, x->now.force_N, miss);
    return vnorm(miss) < 0.5f * fmaxf(vnorm(force), vnorm(x->now.force_N)) + 0.01f;
}

/* Measures the drift: the change of the last tick's force by the new patch occurred without motion. The free shape
 * moves on as tissue vibrates, creeps and rotates. Oscillations (tremor, an unstable loop) are not drift. */
static void measure_drift(hrt_extrapolation *x) {
    hrt_touch trial = x->touch;
    float force[3], drift[3];
    vset(x->tick_tip_m, trial.drag_tip_m);
    trial.drag_us = x->tick_us;
    if (!hrt_contact_force(x->patch, &trial, x->touch.drag_us, x->touch.drag_tip_m, force)) return;
    vsub(force, x->patch_N, drift);
    vscale(1.0f / x->interval_s, drift, drift);
    const float share = fminf(1.0f, x->interval_s / DRIFT_S);
    const float most = fmaxf(vdot(drift, drift), vdot(x->drift_N_s, x->drift_N_s));
    x->drift_lasted += share * (vdot(drift, x->drift_N_s) - DRIFT_FORGOTTEN * x->drift_lasted);
    x->drift_was += share * (most - DRIFT_FORGOTTEN * x->drift_was);
    for (int i = 0; i < 3; i++) x->drift_N_s[i] += share * (drift[i] - x->drift_N_s[i]);
}

bool hrt_evidence_patch(hrt_extrapolation *x, bool same_tissue) {
    if (!same_tissue) x->patch_ticks = 0;
    if (x->cutting && !agrees(x)) return false;
    if (x->patch_ticks > 1 && x->interval_s > 1.0e-3f) measure_drift(x);
    return true;
}

/* Share of a patch's force change that occurs under an active cautery; the rest is cut before it is rendered. */
static const float CUTTING_SHARE = 0.18f;

/* Reduces the patch's force change since the sample while this tool cuts. Not for tissue that another tool cuts: the
 * next patch shows what remains, and this tool's support changes little. */
static void limit_cutting(const hrt_extrapolation *x, float force[3]) {
    float change[3];
    if (!x->cutting) return;
    vsub(force, x->now.force_N, change);
    vadd(force, CUTTING_SHARE - 1.0f, change);
}

/* Adds the drift since the sample to the patch's force. It covers two intervals at most and a limited share of the
 * force, so zero force does not drift. */
void hrt_drift_follow(hrt_extrapolation *x, int64_t now_us, float force[3]) {
    if (x->patch_ticks < 2) {
        for (int i = 0; i < 3; i++) x->drift_N_s[i] = 0.0f;
        x->drift_lasted = x->drift_was = 0.0f;
        x->patch_ticks++;
    }
    vset(force, x->patch_N);
    limit_cutting(x, force);
    const float age_s = hrt_clamp(hrt_seconds(now_us - x->now.t_us), 0.0f, 2.0f * x->interval_s);
    float drifted[3];
    const float lasts = x->drift_was > 0.0f ? hrt_clamp(x->drift_lasted / x->drift_was, 0.0f, 1.0f) : 0.0f;
    vscale(lasts * age_s, x->drift_N_s, drifted);
    const float size = vnorm(drifted), most = DRIFT_MAX * vnorm(force);
    vadd(force, size > most ? most / size : 1.0f, drifted);
}
#endif
