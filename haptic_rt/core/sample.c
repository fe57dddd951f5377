/* What comes from outside is checked here, outside the tick: finite, bounded, indices in range, compliance positive
 * semidefinite. */
#include "internal.h"

static const float FORCE_HUGE_N = 1000.0f;

static const char *const reject_text[HRT_REJECT_COUNT] = {
    "accepted",
    "a value is not finite",
    "a value is beyond any sense",
    "the compliance is not positive semidefinite",
    "a count or an index is out of range",
    "for another controller or instrument",
    "from the future",
    "overtaken by a newer one",
};

const char *hrt_reject_text(hrt_reject reject) {
    return (int)reject >= 0 && reject < HRT_REJECT_COUNT ? reject_text[reject] : "unknown";
}

static float largest(const float *x, int32_t n) {
    float most = 0.0f;
    for (int32_t i = 0; i < n; i++) most = fmaxf(most, fabsf(x[i]));
    return most;
}

hrt_reject hrt_sample_check(hrt_sample *sample, const hrt_params *params) {
    if (!hrt_finite_n(sample->tip_m, 3) || !hrt_finite_n(sample->force_N, 3) || !hrt_finite_n(sample->stiffness_N_m, 9))
        return HRT_REJECT_NOT_FINITE;
    if (largest(sample->tip_m, 3) > 2.0f || largest(sample->force_N, 3) > FORCE_HUGE_N ||
        largest(sample->stiffness_N_m, 9) > 1.0e9f || sample->t_us < 0)
        return HRT_REJECT_HUGE;
    if (sample->stiffness_kind < 0 || sample->stiffness_kind > 2 || hrt_flags_rule(sample->flags) == HRT_RULE_REFUSE)
        return HRT_REJECT_INDEX;
    const float norm = hrt_norm9(sample->stiffness_N_m);
    sample->stiffness_bounded = norm > params->stiffness_max_N_m;
    if (sample->stiffness_bounded)
        for (int i = 0; i < 9; i++) sample->stiffness_N_m[i] *= params->stiffness_max_N_m / norm;
    return HRT_ACCEPT;
}

static int32_t packed(int32_t n, int32_t i, int32_t j) { return i * (2 * n - i - 1) / 2 + j; }

/* LDL^T in place; a pivot within rounding of zero must have a row within rounding of zero. */
static bool semidefinite(float *a, int32_t n, float most) {
    const float tolerance = 1.0e-5f * (float)n * most;
    for (int32_t k = 0; k < n; k++) {
        const float pivot = a[packed(n, k, k)];
        if (pivot < -tolerance) return false;
        if (pivot <= tolerance) {
            for (int32_t j = k + 1; j < n; j++)
                if (fabsf(a[packed(n, k, j)]) > 10.0f * sqrtf(tolerance * most)) return false;
            continue;
        }
        for (int32_t i = k + 1; i < n; i++) {
            const float factor = a[packed(n, k, i)] / pivot;
            if (factor == 0.0f) continue;
            for (int32_t j = i; j < n; j++) a[packed(n, i, j)] -= factor * a[packed(n, k, j)];
        }
    }
    return true;
}

/* What a sender may leave out. */
static void fill_in(hrt_patch *patch, int32_t n) {
    if (!(largest(patch->rest_m, n) > 0.0f))
        for (int32_t i = 0; i < n; i++) patch->rest_m[i] = patch->vertex_m[i];
    bool named = false;
    for (int32_t t = 0; t < patch->triangle_count; t++) named = named || patch->face[t] != 0;
    for (int32_t t = 0; t < patch->triangle_count && !named; t++) patch->face[t] = t;
    if (!(patch->force_cap_N > 0.0f)) patch->force_cap_N = 50.0f;
}

hrt_reject hrt_patch_prepare(hrt_patch *patch, float scratch[HRT_PATCH_COMPLIANCE]) {
    if (patch->vertex_count < 3 || patch->vertex_count > HRT_PATCH_MAX_VERTICES || patch->triangle_count < 1 ||
        patch->triangle_count > HRT_PATCH_MAX_TRIANGLES)
        return HRT_REJECT_INDEX;
    const int32_t n = 3 * patch->vertex_count;
    for (int32_t t = 0; t < patch->triangle_count; t++) {
        const uint8_t *corner = &patch->triangle[HRT_XYZ * t];
        for (int i = 0; i < 3; i++)
            if (corner[i] >= patch->vertex_count || corner[i] == corner[(i + 1) % 3]) return HRT_REJECT_INDEX;
    }
    if (!hrt_finite_n(patch->vertex_m, n) || !hrt_finite_n(patch->rest_m, n) ||
        !hrt_finite_n(patch->compliance_m_N, n * (n + 1) / 2) || !hrt_finite(patch->radius_m) ||
        !hrt_finite(patch->force_cap_N) || !hrt_finite(patch->contact_length_m) ||
        !hrt_finite(patch->skin_compliance_m_N))
        return HRT_REJECT_NOT_FINITE;
    const float most = largest(patch->compliance_m_N, n * (n + 1) / 2);
    if (largest(patch->vertex_m, n) > 2.0f || largest(patch->rest_m, n) > 2.0f || most > 10.0f ||
        patch->radius_m < 1.0e-4f || patch->radius_m > 0.1f || patch->contact_length_m < 0.0f ||
        patch->contact_length_m > 1.0f || patch->skin_compliance_m_N < 0.0f || patch->skin_compliance_m_N > 10.0f ||
        !(patch->film_s_m >= 0.0f && patch->film_s_m <= 1.0f) || patch->force_cap_N > FORCE_HUGE_N)
        return HRT_REJECT_HUGE;
    for (int32_t i = 0; i < n * (n + 1) / 2; i++) scratch[i] = patch->compliance_m_N[i];
    if (!semidefinite(scratch, n, most)) return HRT_REJECT_ASYMMETRIC;
    fill_in(patch, n);
    return hrt_patch_topology_build(patch) ? HRT_ACCEPT : HRT_REJECT_INDEX;
}
