/* The law `adaptive`: a blend of several laws, weighted by how well each predicted recent samples.
 *
 * Each law's force is recorded in every tick. A sample gives the true force at its own time t. Each law's error is its
 * recorded force at t, computed from the samples available then, less the true force. Latency, loss and phase thus
 * enter the errors.
 *
 * The weights are exponential in the decayed sum of squared errors; the rate is inverse to the minimum sum.
 * Exponentially weighted average forecaster: Cesa-Bianchi, Lugosi, Prediction, Learning, and Games, 2006, chapter 2.
 * The rate: Auer, Cesa-Bianchi, Gentile, J. Comput. Syst. Sci. 64, 2002. */
#include "internal.h"

#if HRT_WITH_ADAPTIVE

static const float RECORD_US = 1900.0f; /* ticks closer than this share a record */
static const float HALF_SAMPLES = 2.0f; /* half-life of an error, in samples, */
static const float HALF_MIN_S = 0.03f;  /* or at least this time, where samples come more often */
static const float RATE = 3.0f;         /* rate of the weights, relative to the minimum sum */
static const float FLOOR = 2.0e-3f;     /* errors below this share of the force are not distinguished */
static const float TELLING = 0.03f;     /* errors decay only if the worst is not far below this share of the force */
static const float PEAK_FORCE_KEPT = 0.98f; /* decay of the peak force per sample */
static const float PEAK_FORCE_MIN_N =
    1.0e-2f; /* minimum scale: at first contact, smaller errors do not separate the laws */
/* Initial sums: a patch models the surface, the other laws have only the last force: 3 % of the force, which tells as
 * much as TELLING. Where all laws err by 1 to 2 %, larger sums decay slowly: 10 % kept the blend from the best law for
 * ten samples. */
static const float LOSS_PATCH = 1.0e-4f, LOSS_OTHER = 1.0e-3f;

void hrt_adaptive_reset(hrt_adaptive *a) {
    a->count = a->newest = 0;
    a->recent_peak_N = 0.0f;
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) a->loss[i] = i == HRT_ADAPTIVE_PATCH ? LOSS_PATCH : LOSS_OTHER;
}

/* Returns e^-x for x >= 0, with an absolute error of at most 0.01. */
static float fallen(float x) {
    const float once = 1.0f / (1.0f + 0.0625f * x), twice = once * once, four = twice * twice, eight = four * four;
    return eight * eight;
}

static void set_weights(hrt_adaptive *a, bool with_patch) {
    const int laws = with_patch ? HRT_ADAPTIVE_LAWS : HRT_ADAPTIVE_PATCH;
    float least = a->loss[0], sum = 0.0f;
    for (int i = 1; i < laws; i++) least = fminf(least, a->loss[i]);
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) {
        a->weight[i] = i < laws ? fallen(RATE * (a->loss[i] - least) / (least + FLOOR * FLOOR)) : 0.0f;
        sum += a->weight[i];
    }
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) a->weight[i] /= sum; /* the best law has weight 1 before this */
}

void hrt_adaptive_blend(hrt_adaptive *a, int64_t now_us, bool with_patch, float said_N[HRT_ADAPTIVE_LAWS][3],
                        float force_N[3]) {
    set_weights(a, with_patch);
    for (int c = 0; c < 3; c++) {
        force_N[c] = 0.0f;
        for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) force_N[c] += a->weight[i] * said_N[i][c];
    }
    if (a->count && !hrt_older(now_us - a->record[a->newest].t_us, RECORD_US)) return;
    a->newest = a->count ? (a->newest + 1) % HRT_ADAPTIVE_RECORDS : 0;
    if (a->count < HRT_ADAPTIVE_RECORDS) a->count++;
    hrt_adaptive_record *to = &a->record[a->newest];
    to->t_us = now_us;
    to->with_patch = with_patch;
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) vset(said_N[i], to->force_N[i]);
}

/* Finds the last record at or before t_us and the next one, which may be the same. Returns false if all are later. */
static bool find(const hrt_adaptive *a, int64_t t_us, const hrt_adaptive_record **before,
                 const hrt_adaptive_record **after) {
    *after = NULL;
    for (int32_t back = 0; back < a->count; back++) {
        const int32_t at = (a->newest + HRT_ADAPTIVE_RECORDS - back) % HRT_ADAPTIVE_RECORDS;
        *before = &a->record[at];
        if (!*after) *after = *before;
        if (a->record[at].t_us <= t_us) return true;
        *after = *before;
    }
    return false;
}

static float square_of_miss(const hrt_adaptive_record *before, const hrt_adaptive_record *after, float share, int law,
                            const float force_N[3]) {
    float miss2 = 0.0f;
    for (int c = 0; c < 3; c++) {
        const float said = (1.0f - share) * before->force_N[law][c] + share * after->force_N[law][c];
        miss2 += (said - force_N[c]) * (said - force_N[c]);
    }
    return miss2;
}

/* Returns whether the laws that extrapolate samples had one with a force. If not, a first force misses all of them by
 * itself, and a patch by nearly as much where the tool has just arrived: it says nothing about how they go on. */
static bool had_a_sample_in_contact(const hrt_adaptive_record *record) {
    float sum2 = 0.0f;
    for (int i = 0; i < HRT_ADAPTIVE_PATCH; i++) sum2 += vdot(record->force_N[i], record->force_N[i]);
    return sum2 > 0.0f;
}

void hrt_adaptive_judge(hrt_adaptive *a, int64_t t_us, float interval_s, const float force_N[3]) {
    const hrt_adaptive_record *before, *after;
    if (!find(a, t_us, &before, &after)) return;
    const float span_us = hrt_us(after->t_us - before->t_us);
    const float share = span_us > 0.0f ? hrt_clamp(hrt_us(t_us - before->t_us) / span_us, 0.0f, 1.0f) : 0.0f;
    const bool with_patch = before->with_patch && after->with_patch;
    float miss2[HRT_ADAPTIVE_LAWS], worst2 = 0.0f, any2 = vdot(force_N, force_N);
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++) {
        miss2[i] = square_of_miss(before, after, share, i, force_N);
        any2 += vdot(before->force_N[i], before->force_N[i]);
        if (i != HRT_ADAPTIVE_PATCH || with_patch) worst2 = fmaxf(worst2, miss2[i]);
    }
    if (!(any2 > 0.0f)) return; /* without contact, errors neither grow nor decay */
    a->recent_peak_N = fmaxf(PEAK_FORCE_KEPT * a->recent_peak_N, vnorm(force_N));
    if (!had_a_sample_in_contact(before)) return;
    const float scale2 = fmaxf(a->recent_peak_N, PEAK_FORCE_MIN_N) * fmaxf(a->recent_peak_N, PEAK_FORCE_MIN_N);
    /* Errors decay only as far as the worst law erred: otherwise the sample carries no information. A decay of
     * 1/(1+t/T) per sample t has half-life h = 2 t for T = t / (sqrt 2 - 1). */
    const float time_s = 1.207f * fmaxf(HALF_SAMPLES * interval_s, HALF_MIN_S);
    const float tells = worst2 / (worst2 + TELLING * TELLING * scale2);
    const float kept = time_s / (time_s + tells * fmaxf(interval_s, 1.0e-4f));
    for (int i = 0; i < HRT_ADAPTIVE_LAWS; i++)
        if (i != HRT_ADAPTIVE_PATCH || with_patch) a->loss[i] = kept * a->loss[i] + miss2[i] / scale2;
}

#endif
