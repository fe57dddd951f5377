/* The extrapolators, one row of the table each. All are defined and bounded at standstill, on reversal and with jitter
 * of one count. controller.c has handled order and loss of samples before. */
#include "internal.h"

#if HRT_WITH_EVIDENCE
/* Minimum interval of a difference; over less time, noise dominates. */
static const float DIFFERENCE_US = 15000.0f;
#endif
typedef struct moment {
    const hrt_params *params;
    float age_s;       /* t - t_n, clamped to the horizon */
    float moved_m[3];  /* P - P_n, clamped to the horizon */
    float interval_s;  /* t_n - t_m; m is the reference sample for differences */
    float step_m[3];   /* P_n - P_m */
    float change_N[3]; /* F_n - F_m */
} moment;

static float capped_ratio(const moment *m, float ratio) {
    return hrt_clamp(ratio, -m->params->ratio_max, m->params->ratio_max);
}

/* Returns the squared displacement, regularised at standstill: one or two counts carry no information. */
static float guarded_square(const hrt_params *params, const float step_m[3]) {
    return vdot(step_m, step_m) + params->standstill_m * params->standstill_m;
}

/* Removes the force component against the contact force of a probe: tissue pushes but never pulls. A grasper may be
 * pulled, but an estimate must not reverse its force. While jaws open, the force falls without motion; an estimate
 * would extrapolate that past zero. */
static void only_push(const hrt_extrapolation *x, bool estimated, float force[3]) {
    const float *touch = vnorm(x->now.force_N) > 0.0f ? x->now.force_N : x->previous.force_N;
    const float size2 = vdot(touch, touch);
    if (!(x->now.unilateral || estimated) || !(size2 > 0.0f)) return;
    const float along = vdot(force, touch);
    if (along < 0.0f) vadd(force, -along / size2, touch);
}

static void law_hold(hrt_extrapolation *x, const moment *m, float force[3]) { (void)x, (void)m, (void)force; }

static void law_time(hrt_extrapolation *x, const moment *m, float force[3]) {
    if (x->have < 2) return;
    vadd(force, capped_ratio(m, m->age_s / fmaxf(m->interval_s, 1.0e-3f)), m->change_N);
}

static void law_position(hrt_extrapolation *x, const moment *m, float force[3]) {
    if (x->have < 2) return;
    vadd(force, capped_ratio(m, vdot(m->moved_m, m->step_m) / guarded_square(m->params, m->step_m)), m->change_N);
    only_push(x, true, force);
}

/* As published: a ratio of lengths, so the force keeps growing after a reversal. For comparison only. */
static void law_paper_position(hrt_extrapolation *x, const moment *m, float force[3]) {
    const float square = vdot(m->step_m, m->step_m);
    if (x->have < 2 || !(square > 1.0e-12f)) return;
    vadd(force, capped_ratio(m, fabsf(vdot(m->moved_m, m->step_m)) / square), m->change_N);
}

static void add_stiffness(const float stiffness[9], float share, const float moved[3], float force[3]) {
    float change[3];
    hrt_apply(stiffness, moved, change);
    vadd(force, share, change);
}

static void law_broyden(hrt_extrapolation *x, const moment *m, float force[3]) {
    if (x->broyden_bounded) x->limits |= HRT_LIMIT_STIFFNESS;
    add_stiffness(x->broyden_N_m, 1.0f, m->moved_m, force);
    only_push(x, true, force);
}

/* Uses the sample's stiffness, else Broyden's estimate. */
static void law_tangent(hrt_extrapolation *x, const moment *m, float force[3]) {
    if (x->now.stiffness_kind == 0) {
        law_broyden(x, m, force);
        return;
    }
    if (x->now.stiffness_bounded) x->limits |= HRT_LIMIT_STIFFNESS;
    add_stiffness(x->now.stiffness_N_m, HRT_WITH_EVIDENCE ? hrt_evidence_trust(x) : 1.0f, m->moved_m, force);
    only_push(x, false, force);
}

/* `local_model` off its patch: uses the sample's stiffness, else the last force change by motion alone. */
static void law_off_patch(hrt_extrapolation *x, const moment *m, float force[3]) {
    if (HRT_WITH_EVIDENCE && x->cut) return; /* no stiffness predicts the next cut */
    if (!HRT_WITH_EVIDENCE || x->now.stiffness_kind != 0)
        law_tangent(x, m, force);
    else
        law_position(x, m, force);
}

typedef struct law {
    const char *name;
    void (*force)(hrt_extrapolation *x, const moment *m, float force[3]); /* force is F_n on entry */
} law;

#define ROW(id, name, law) {name, law},
static const law laws[HRT_EXTRAPOLATOR_COUNT] = {HRT_EXTRAPOLATORS(ROW)};
_Static_assert(HRT_HOLD == 0 && HRT_LOCAL_MODEL == 5 && HRT_PAPER_POSITION == 6 && HRT_ADAPTIVE == 7,
               "messages and logs carry these numbers");

const char *hrt_extrapolator_name(hrt_extrapolator which) {
    return (int)which >= 0 && which < HRT_EXTRAPOLATOR_COUNT ? laws[which].name : "unknown";
}

bool hrt_extrapolator_find(const char *name, hrt_extrapolator *which) {
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        if (!hrt_same_name(laws[w].name, name)) continue;
        *which = (hrt_extrapolator)w;
        return true;
    }
    return false;
}

void hrt_extrapolation_reset(hrt_extrapolation *x, hrt_extrapolator which) {
    static const hrt_extrapolation zero = {.which = HRT_HOLD};
    *x = zero;
    x->which = which;
#if HRT_WITH_ADAPTIVE
    hrt_adaptive_reset(&x->adaptive);
#endif
}

static bool uses_patch(const hrt_extrapolation *x) { return x->which == HRT_LOCAL_MODEL || x->which == HRT_ADAPTIVE; }

void hrt_extrapolation_select(hrt_extrapolation *x, hrt_extrapolator which) {
    if (x->which == which) return;
    x->which = which;
    x->changed = 1;
    x->on_patch = false;
    hrt_local_model_clear(&x->touch);
#if HRT_WITH_ADAPTIVE
    hrt_adaptive_reset(&x->adaptive);
#endif
}

/* Updates Broyden's estimate from the last force difference. Not called after a cut: its force change is not caused by
 * motion. */
static void update_broyden(hrt_extrapolation *x, const hrt_params *params) {
    float step[3], miss[3], predicted[3];
    vsub(x->now.tip_m, x->previous.tip_m, step);
    vsub(x->now.force_N, x->previous.force_N, miss);
    hrt_apply(x->broyden_N_m, step, predicted);
    vadd(miss, -1.0f, predicted);
    const float square = guarded_square(params, step);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) x->broyden_N_m[3 * i + j] += miss[i] * step[j] / square;
    /* Without contact the stiffness is zero. */
    const float now = vnorm(x->now.force_N), before = vnorm(x->previous.force_N);
    const bool untouched = !(now > 0.0f) && !(before > 0.0f);
    const float norm = hrt_norm9(x->broyden_N_m);
    x->broyden_bounded = norm > params->stiffness_max_N_m;
    const float share = untouched ? 0.0f : norm > params->stiffness_max_N_m ? params->stiffness_max_N_m / norm : 1.0f;
    for (int i = 0; i < 9; i++) x->broyden_N_m[i] *= share;
}

/* Returns the sample's patch, or null if unusable: of another topology revision, with a grasp for a probe, or with
 * unsupported friction. */
static const hrt_patch *usable(const hrt_sample *sample) {
    const hrt_patch *patch = HRT_WITH_PATCHES ? sample->patch : NULL;
    const bool unusable = patch && (patch->topology_revision != sample->topology_revision ||
                                    (sample->unilateral && hrt_patch_grasps(patch)) ||
                                    (!HRT_WITH_FRICTION && patch->friction_static > 0.0f));
    return unusable ? NULL : patch;
}

static void take_patch(hrt_extrapolation *x) {
    const hrt_patch *fresh = usable(&x->now);
    /* A cut, or closed or opened jaws, make it another tissue. Its equilibrium is found only in the second tick, so
     * blend from that tick's force on. For the same tissue a sample applies at once: a blend delays the hand's loop.
     * Released tissue applies at once too. `adaptive` does not blend: at an unpredicted cut it equals `hold`, and a
     * blend made it 5 to 8 % worse under a cautery. */
    bool other = x->cut || (x->patch && fresh && hrt_patch_grasps(x->patch) != hrt_patch_grasps(fresh));
#if HRT_WITH_EVIDENCE
    const bool cutting = (x->now.flags & HRT_FLAG_CUTTING) != 0;
    other = other || cutting != x->cutting;
    x->cutting = cutting;
#endif
    if ((x->now.flags & HRT_FLAG_RELEASING) != 0)
        x->changed = x->blending = 0, x->on_patch = false;
    else if (other && x->on_patch && x->which != HRT_ADAPTIVE)
        x->changed = 2;
    if (x->on_patch && x->patch && fresh)
        hrt_local_model_warm(&x->touch, x->patch, fresh);
    else
        hrt_local_model_clear(&x->touch);
    x->patch = fresh;
    x->patch_us = x->now.t_us;
    x->patch_left = false;
#if HRT_WITH_EVIDENCE
    x->patch_left = uses_patch(x) && fresh && !hrt_evidence_patch(x, !other);
#endif
}

static __attribute__((noinline)) void remember(const hrt_sample *sample, hrt_past *past) {
    past->t_us = sample->t_us;
    vset(sample->tip_m, past->tip_m);
    vset(sample->force_N, past->force_N);
#if HRT_WITH_EVIDENCE
    for (int i = 0; i < 9; i++) past->stiffness_N_m[i] = sample->stiffness_kind != 0 ? sample->stiffness_N_m[i] : 0.0f;
#endif
}

#if HRT_WITH_EVIDENCE
/* Returns whether the difference spans enough time. Samples may come in every tick, so the reference is an older one.
 */
static bool is_far_apart(hrt_extrapolation *x) {
    if (hrt_older(x->now.t_us - x->candidate.t_us, DIFFERENCE_US)) {
        x->previous = x->candidate;
        remember(&x->now, &x->candidate);
    }
    return hrt_older(x->now.t_us - x->previous.t_us, DIFFERENCE_US);
}
#else
/* Firmware receives samples one frame apart. */
static bool is_far_apart(const hrt_extrapolation *x) { return (void)x, true; }
#endif

/* Takes over a sample. Restarts differences after a cut or a release: that force change is not caused by motion. Scales
 * Broyden's stiffness with the force that remains after a cut; released tissue has none. */
void hrt_extrapolation_sample(hrt_extrapolation *x, const hrt_params *params, const hrt_sample *sample) {
    const bool anew = x->have == 0 || ((sample->flags | x->now.flags) & HRT_FLAG_RELEASING) != 0;
    const float was_N = vnorm(x->now.force_N);
    x->cut = x->have != 0 && x->now.topology_revision != sample->topology_revision;
#if HRT_WITH_EVIDENCE
    x->interval_s = hrt_seconds(sample->t_us - x->now.t_us);
#else
    remember(&x->now, &x->previous);
#endif
#if HRT_WITH_ADAPTIVE
    if (x->which == HRT_ADAPTIVE && x->have)
        hrt_adaptive_judge(&x->adaptive, sample->t_us, hrt_seconds(sample->t_us - x->now.t_us), sample->force_N);
#endif
    x->now = *sample;
    if (hrt_flags_rule(sample->flags) >= HRT_RULE_FORCE_ONLY) {
        x->now.stiffness_kind = 0;
        x->now.patch = NULL;
    }
    x->have = is_far_apart(x) && !anew ? 2 : 1;
    if (x->have == 2) {
        if (!x->cut) update_broyden(x, params);
        if (HRT_WITH_EVIDENCE) hrt_evidence_judge(x);
    }
    if (anew || x->cut) {
        const float is_N = vnorm(x->now.force_N), share = anew ? 0.0f : is_N < was_N ? is_N / was_N : 1.0f;
        for (int i = 0; i < 9; i++) x->broyden_N_m[i] *= share;
        x->have = 1;
        remember(&x->now, &x->previous);
#if HRT_WITH_EVIDENCE
        x->candidate = x->previous;
#endif
    }
    take_patch(x);
}

static void cap_length(float v[3], float most, uint32_t *limits) {
    const float size = vnorm(v);
    if (!(size > most)) return;
    vscale(most / size, v, v);
    *limits |= HRT_LIMIT_HORIZON;
}

static void describe(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3], moment *m) {
    m->params = params;
    const float age_us = hrt_us(now_us - x->now.t_us);
    if (age_us > params->horizon_us) x->limits |= HRT_LIMIT_HORIZON;
    m->age_s = 1.0e-6f * hrt_clamp(age_us, 0.0f, params->horizon_us);
    vsub(tip_m, x->now.tip_m, m->moved_m);
    cap_length(m->moved_m, params->horizon_m, &x->limits);
    m->interval_s = hrt_seconds(x->now.t_us - x->previous.t_us);
    vsub(x->now.tip_m, x->previous.tip_m, m->step_m);
    vsub(x->now.force_N, x->previous.force_N, m->change_N);
}

/* Computes the patch's force. Returns false if there is none, or the tool has left it. */
static bool on_the_patch(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3],
                         float force[3]) {
    const bool young = HRT_WITH_PATCHES && x->patch && !hrt_older(now_us - x->patch_us, params->patch_stale_us);
    if (young && !x->patch_left) {
#if HRT_WITH_EVIDENCE
        vset(x->touch.drag_tip_m, x->tick_tip_m);
        x->tick_us = x->touch.drag_us;
#endif
        if (hrt_contact_force(x->patch, &x->touch, now_us, tip_m, force)) {
#if HRT_WITH_EVIDENCE
            hrt_drift_follow(x, now_us, force);
#endif
            return true;
        }
        x->patch_left = true; /* until a new patch comes */
    }
    x->limits |= HRT_LIMIT_PATCH;
#if HRT_WITH_EVIDENCE
    x->patch_ticks = 0;
#endif
    return false;
}

#if HRT_WITH_ADAPTIVE
/* Bounds the force change predicted from an old sample to half of the recent peak force. A hand moves far while a
 * simulation lags, beyond the tissue that the prediction holds for. */
static void bound_change(const hrt_extrapolation *x, float said_N[3]) {
    const float most = 0.5f * fmaxf(x->adaptive.recent_peak_N, vnorm(x->now.force_N));
    float change[3];
    vsub(said_N, x->now.force_N, change);
    const float size = vnorm(change);
    if (size > most) vadd(said_N, most / size - 1.0f, change);
}

/* Blends the laws; `force` is the patch's on entry if with_patch. */
static void law_adaptive(hrt_extrapolation *x, const moment *m, int64_t now_us, bool with_patch, float force[3]) {
    static void (*const blended[HRT_ADAPTIVE_PATCH])(hrt_extrapolation *, const moment *,
                                                     float[3]) = {law_hold, law_position, law_tangent};
    float said[HRT_ADAPTIVE_LAWS][3];
    for (int i = 0; i < HRT_ADAPTIVE_PATCH; i++) {
        vset(x->now.force_N, said[i]);
        blended[i](x, m, said[i]);
        bound_change(x, said[i]);
    }
    vset(with_patch ? force : x->now.force_N, said[HRT_ADAPTIVE_PATCH]);
    hrt_adaptive_blend(&x->adaptive, now_us, with_patch, said, force);
}
#endif

/* Computes the law's force, without blending. Returns whether it is the patch's. */
static bool evaluate(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3],
                     float force[3]) {
    moment m;
    describe(x, params, now_us, tip_m, &m);
    const bool on_patch = uses_patch(x) && on_the_patch(x, params, now_us, tip_m, force);
#if HRT_WITH_ADAPTIVE
    if (x->which == HRT_ADAPTIVE) {
        law_adaptive(x, &m, now_us, on_patch, force);
        return on_patch;
    }
#endif
    if (on_patch) return true;
    vset(x->now.force_N, force);
    /* A grasper without force has no contact: the last force change came from its opening jaws, not from motion. */
    if (!x->now.unilateral && !(vnorm(force) > 0.0f)) return false;
    laws[x->which].force(x, &m, force);
    return false;
}

static const float FORGOTTEN = 5.0e-4f; /* decay of the peak force per tick */
#if HRT_WITH_EVIDENCE
static const float SLIGHT_N = 0.1f; /* minimum peak force for the rate of a blend */
#endif

/* Blends the force to another law or another tissue of `local_model` without a jump. The rate takes the recent peak
 * force to zero in blend_us, so small steps apply at once.
 *
 * To another tissue the force moves at that rate, or at the law's own if that is faster. To another law of the same
 * tissue the rate adds to the law's own: a delay would make a stiff contact oscillate. */
static void blend_transfer(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, float force[3]) {
    float ahead[3], moved[3];
#if HRT_WITH_EVIDENCE
    const float over_us = fminf(params->blend_us, 1.4e6f * x->interval_s); /* ends before many newer samples */
    const float whole_N = fmaxf(x->recent_peak_N, SLIGHT_N);
#else
    const float over_us = params->blend_us, whole_N = x->recent_peak_N;
#endif
    float pace_N = whole_N * hrt_us(now_us - x->blend_us_left) / fmaxf(over_us, 1.0f), own_N = 0.0f;
    vsub(force, x->last_N, ahead);
    vset(ahead, moved);
    vadd(moved, 1.0f, x->blend_offset_N);
    x->blend_us_left = now_us;
    if (!x->changed) {
        own_N = vnorm(moved);
    } else if (x->last_valid) { /* samples may come in every tick: a blend in progress goes on */
        if (!x->blending) pace_N = 0.0f;
        if (x->changed > x->blending) x->blending = x->changed;
    }
    if (x->changed) x->changed--;
    if (!x->blending) return;
    const float step_N = x->blending > 1 ? fmaxf(pace_N, own_N) : pace_N + own_N, ahead_N = vnorm(ahead);
    if (!(ahead_N > step_N)) {
        x->blending = 0;
        return;
    }
    vscale(step_N / ahead_N - 1.0f, ahead, x->blend_offset_N);
    vadd(force, 1.0f, x->blend_offset_N);
}

void hrt_extrapolation_force(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3],
                             float force_N[3]) {
    x->limits = 0;
    for (int i = 0; i < 3; i++) force_N[i] = 0.0f;
    if (!x->have) return;
    const bool on_patch = evaluate(x, params, now_us, tip_m, force_N);
    if (uses_patch(x) && on_patch != x->on_patch && !x->changed) x->changed = 1;
    x->on_patch = on_patch;
    x->recent_peak_N = fmaxf((1.0f - FORGOTTEN) * x->recent_peak_N, vnorm(force_N));
    blend_transfer(x, params, now_us, force_N);
    vset(force_N, x->last_N);
    x->last_valid = true;
}
