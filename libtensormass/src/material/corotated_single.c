/* Forms of the corotated correction in single precision, and its batches. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "material/single_batches.h"

#define TM_KERNEL "material/corotated_kernel.h"
#define TM_FORM(form, x) tm_turn_##form##_##x
#include "material/single_forms.h"

tm_rotation_kernel tm_single_rotation_form(int form) {
#ifdef TM_HAS_AVX2
    if (form == 1 && __builtin_cpu_supports("avx2")) return tm_turn_avx2_force;
#endif
#ifdef TM_HAS_NEON
    if (form == 1) return tm_turn_neon_force;
#endif
    return form == 0 ? tm_turn_plain_force : NULL;
}

tm_rotation_kernel tm_single_rotation_choose(bool plain) {
    const tm_rotation_kernel best = plain ? NULL : tm_single_rotation_form(1);
    return best ? best : tm_single_rotation_form(0);
}

tm_corner_force_kernel tm_single_corner_force_choose(bool plain) {
    const tm_rotation_kernel form = tm_single_rotation_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_turn_avx2_force) return tm_turn_avx2_pulls;
#endif
#ifdef TM_HAS_NEON
    if (form == tm_turn_neon_force) return tm_turn_neon_pulls;
#endif
    (void)form;
    return tm_turn_plain_pulls;
}

void tm_narrow(const double *from, int32_t count, float *to) {
    for (int32_t i = 0; i < count; i++) to[i] = from[i] < (double)3e38f ? (float)from[i] : 3e38f; /* no limit: 1e300 */
}

const tm_single_batch *tm_single_batch_take(tm_pool *pool, const tm_tet_batches *batches) {
    tm_single_batch *to = TM_ALLOC(pool, tm_single_batch, batches->count);
    for (int32_t p = 0; to && p < batches->count; p++) {
        const tm_tet_batch *from = batches->batch + p;
        memcpy(to[p].component, from->component, sizeof to[p].component);
        tm_narrow(from->shape_1_m[0], 9 * TM_LANES, to[p].shape_1_m[0]);
        tm_narrow(from->mu_J, TM_LANES, to[p].mu_J);
        tm_narrow(from->lambda_J, TM_LANES, to[p].lambda_J);
    }
    return to;
}

static const tm_single_fibres *take_fibres(tm_pool *pool, const tm_tet_batches *batches) {
    int32_t count = 0;
    for (int32_t p = 0; p < batches->count; p++) count += batches->fibred_of[p] >= 0;
    tm_single_fibres *to = TM_ALLOC(pool, tm_single_fibres, count);
    for (int32_t n = 0; to && n < count; n++) {
        const tm_fibre_batch *from = batches->fibred + n;
        tm_narrow(from->dlambda_J, TM_LANES, to[n].dlambda_J);
        tm_narrow(from->dmu_J, TM_LANES, to[n].dmu_J);
        tm_narrow(from->beta_J, TM_LANES, to[n].beta_J);
        tm_narrow(from->fibre[0], 3 * TM_LANES, to[n].fibre[0]);
    }
    return to;
}

double tm_single_rounding_m(const tm_mesh *mesh) {
    double most = 0;
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        double way[3];
        vsub(mesh->rest_m + 3 * (int64_t)mesh->edge[2 * e], mesh->rest_m + 3 * (int64_t)mesh->edge[2 * e + 1], way);
        most = fmax(most, vdot(way, way));
    }
    return 4 * (double)FLT_EPSILON * sqrt(most);
}

bool tm_single_rotation_init(tm_tet_batches *batches, tm_pool *pool) {
    tm_single_batches *s = TM_ALLOC(pool, tm_single_batches, 1);
    if (!s) return false;
    *s = (tm_single_batches){.count = batches->count,
                             .span = batches->span,
                             .alive = batches->alive,
                             .batch = tm_single_batch_take(pool, batches),
                             .fibred = batches->fibred_of ? take_fibres(pool, batches) : NULL,
                             .fibred_of = batches->fibred_of,
                             .begin_1_2 = (float)batches->begin_1_2,
                             .width_1_2 = (float)batches->width_1_2};
    batches->single = s;
    return !pool->failed;
}
