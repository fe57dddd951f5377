/* Checks samples and patches from outside, before the tick: finite, bounded, indices in range, compliance positive
 * semidefinite. */
#include "internal.h"

#include "libtensormass/numeric/linear.h"

static const float STIFFNESS_HUGE_N_m = 1.0e9f;
#define FORCE_HUGE_N 1000.0f
#define FRICTION_MAX 2.0f /* as in tensormass/friction.h */

static const char *const reject_text[HRT_REJECT_COUNT] = {
    "accepted",
    "a value is not finite",
    "a value is outside its range",
    "the compliance is not positive semidefinite",
    "a count or an index is out of range",
    "for another controller or instrument",
    "from the future",
    "older than the newest one",
};

const char *hrt_reject_text(hrt_reject reject) {
    return (int)reject >= 0 && reject < HRT_REJECT_COUNT ? reject_text[reject] : "unknown";
}

static __attribute__((noinline)) hrt_reject bounded(const float *x, int32_t n, float most) {
    for (int32_t i = 0; i < n; i++) {
        if (!hrt_finite(x[i])) return HRT_REJECT_NOT_FINITE;
        if (fabsf(x[i]) > most) return HRT_REJECT_HUGE;
    }
    return HRT_ACCEPT;
}

hrt_reject hrt_sample_check(hrt_sample *sample, const hrt_params *params) {
    hrt_reject verdict = bounded(sample->tip_m, 3, 2.0f);
    if (verdict == HRT_ACCEPT) verdict = bounded(sample->force_N, 3, FORCE_HUGE_N);
    if (verdict == HRT_ACCEPT) verdict = bounded(sample->stiffness_N_m, 9, STIFFNESS_HUGE_N_m);
    if (verdict != HRT_ACCEPT) return verdict;
    if (sample->t_us < 0) return HRT_REJECT_HUGE;
    if (sample->stiffness_kind < 0 || sample->stiffness_kind > 2 || hrt_flags_rule(sample->flags) == HRT_RULE_REFUSE)
        return HRT_REJECT_INDEX;
    const float norm = hrt_norm9(sample->stiffness_N_m);
    sample->stiffness_bounded = norm > params->stiffness_max_N_m;
    if (sample->stiffness_bounded)
        for (int i = 0; i < 9; i++) sample->stiffness_N_m[i] *= params->stiffness_max_N_m / norm;
    return HRT_ACCEPT;
}

/* Returns whether a matrix is positive semidefinite within rounding; no entry may exceed the largest diagonal one. */
static __attribute__((noinline)) bool semidefinite(float *a, int32_t width, int32_t n) {
    float most = 0.0f;
    for (int32_t k = 0; k < n; k++) most = fmaxf(most, a[law_packed(width, k, k)]);
    const float least = 1.0e-5f * (float)n * most;
    return law_semidefinite(a, width, n, 0.0f, least, 10.0f * sqrtf(least * most));
}

/* Sets the defaults of values that a sender may omit. */
static void fill_in(hrt_patch *patch, int32_t n) {
    bool named = false, rest = false;
    for (int32_t i = 0; i < n; i++) rest = rest || patch->rest_m[i] != 0.0f;
    for (int32_t i = 0; i < n && !rest; i++) patch->rest_m[i] = patch->vertex_m[i];
    for (int32_t t = 0; t < patch->triangle_count; t++) named = named || patch->face[t] != 0;
    for (int32_t t = 0; t < patch->triangle_count && !named; t++) patch->face[t] = t;
    if (!(patch->force_cap_N > 0.0f)) patch->force_cap_N = 50.0f;
}

/* Checks the scalars of a patch; none may be negative. */
static hrt_reject check_numbers(const hrt_patch *patch) {
    static const float most[] = {FORCE_HUGE_N, 0.1f, 1.0f, 10.0f, 1.0f, 10.0f, 1.0f, FRICTION_MAX};
    const float number[] = {
        patch->force_cap_N, patch->radius_m,        patch->contact_length_m, patch->contact_compliance_m_N,
        patch->drag_s_m,    patch->radiation_N_s_m, patch->radiation_s,      patch->friction_static};
    hrt_reject verdict = HRT_WITH_FRICTION ? bounded(&patch->friction_kinetic, 1, patch->friction_static) : HRT_ACCEPT;
    for (int i = 0; i < (int)(sizeof most / sizeof *most) && verdict == HRT_ACCEPT; i++)
        verdict = number[i] < 0.0f ? HRT_REJECT_HUGE : bounded(&number[i], 1, most[i]);
    return verdict != HRT_ACCEPT ||
                   (patch->radius_m >= 1.0e-4f && (!HRT_WITH_FRICTION || patch->friction_kinetic >= 0.0f))
               ? verdict
               : HRT_REJECT_HUGE;
}

hrt_reject hrt_patch_prepare(hrt_patch *patch, float scratch[HRT_PATCH_COMPLIANCE]) {
    if (patch->vertex_count < 3 || patch->vertex_count > HRT_PATCH_MAX_VERTICES || patch->triangle_count < 1 ||
        patch->triangle_count > HRT_PATCH_MAX_TRIANGLES)
        return HRT_REJECT_INDEX;
    const int32_t n = 3 * patch->vertex_count, width = 3 * hrt_patch_nodes(patch), entries = width * (width + 1) / 2;
    if (width > HRT_PATCH_DOFS || (width > n && patch->grasped >> patch->vertex_count != 1u)) return HRT_REJECT_INDEX;
    for (int32_t t = 0; t < patch->triangle_count; t++) {
        const uint8_t *corner = &patch->triangle[HRT_XYZ * t];
        for (int i = 0; i < 3; i++)
            if (corner[i] >= patch->vertex_count || corner[i] == corner[(i + 1) % 3]) return HRT_REJECT_INDEX;
    }
    const int32_t hold = entries - 2 * (width - n); /* the last six entries are the grasp's stiffness */
    hrt_reject verdict = bounded(patch->vertex_m, width, 2.0f);
    if (verdict == HRT_ACCEPT) verdict = bounded(patch->rest_m, n, 2.0f);
    if (verdict == HRT_ACCEPT) verdict = bounded(patch->compliance_m_N, hold, 10.0f);
    if (verdict == HRT_ACCEPT) verdict = bounded(&patch->compliance_m_N[hold], entries - hold, STIFFNESS_HUGE_N_m);
    if (verdict == HRT_ACCEPT) verdict = bounded(&patch->rest_m[n], width - n, FORCE_HUGE_N);
    if (verdict == HRT_ACCEPT) verdict = check_numbers(patch);
    if (verdict != HRT_ACCEPT) return verdict;
    for (int32_t i = 0; i < entries; i++) scratch[i] = i < hold ? patch->compliance_m_N[i] : -patch->compliance_m_N[i];
    if (!semidefinite(scratch, width, n) || !semidefinite(scratch + hold, 3, width - n)) return HRT_REJECT_ASYMMETRIC;
    fill_in(patch, n);
    return hrt_patch_topology_build(patch) ? HRT_ACCEPT : HRT_REJECT_INDEX;
}
