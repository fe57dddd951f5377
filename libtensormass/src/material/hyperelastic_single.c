/* Forms of the single-precision pass of nonlinear laws, and its batches. */
#include "material/hyperelastic_single.h"

#include <math.h>
#include <string.h>

#include "base/intrinsics.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors never cross a call: every function that takes them is inlined */

#define TM_FLOATS
#define TM_NAME(x) tm_single_plain_##x
#define TM_TARGET
#define TM_WIDTH 4
#include "material/hyperelastic_single_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#ifdef TM_HAS_AVX2
#define TM_NAME(x) tm_single_avx2_##x
#define TM_TARGET __attribute__((target("avx2")))
#define TM_WIDTH 8
#include "material/hyperelastic_single_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#endif

#ifdef TM_HAS_NEON
#define TM_NEON_FORM
#define TM_NAME(x) tm_single_neon_##x
#define TM_TARGET
#define TM_WIDTH 4
#include "material/hyperelastic_single_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#undef TM_NEON_FORM
#endif

#undef TM_FLOATS

tm_single_force tm_single_force_form(int form) {
#ifdef TM_HAS_AVX2
    if (form == 1 && __builtin_cpu_supports("avx2")) return tm_single_avx2_hyper_force;
#endif
#ifdef TM_HAS_NEON
    if (form == 1) return tm_single_neon_hyper_force;
#endif
    return form == 0 ? tm_single_plain_hyper_force : NULL;
}

tm_single_force tm_single_force_choose(bool plain) {
    const tm_single_force best = plain ? NULL : tm_single_force_form(1);
    return best ? best : tm_single_force_form(0);
}

static void narrow(const double *from, int32_t count, float *to) {
    for (int32_t i = 0; i < count; i++) to[i] = from[i] < (double)3e38f ? (float)from[i] : 3e38f; /* no limit: 1e300 */
}

static void convert(const tm_tet_batch *batch, const tm_law_pack *law, tm_single_batch *b, tm_single_laws *l) {
    memcpy(b->component, batch->component, sizeof b->component);
    narrow(batch->shape_1_m[0], 9 * TM_LANES, b->shape_1_m[0]);
    narrow(batch->mu_J, TM_LANES, b->mu_J);
    narrow(batch->lambda_J, TM_LANES, b->lambda_J);
    narrow(law->I3_max, TM_LANES, l->I3_max);
    narrow(law->constant[0], TM_LAW_CONSTANTS * TM_LANES, l->constant[0]);
    narrow(law->dlambda_J, TM_LANES, l->dlambda_J);
    narrow(law->dmu_J, TM_LANES, l->dmu_J);
    narrow(law->beta_J, TM_LANES, l->beta_J);
    narrow(law->fibre[0], 3 * TM_LANES, l->fibre[0]);
    for (int i = 0; i < TM_LANES; i++) l->law[i] = (int32_t)law->law[i];
    l->laws = law->laws;
}

bool tm_single_law_init(tm_single_law *s, tm_pool *pool, const tm_hyperelastic *h) {
    const int32_t count = h->packs.count;
    tm_single_batch *batch = TM_ALLOC(pool, tm_single_batch, count);
    tm_single_laws *law = TM_ALLOC(pool, tm_single_laws, count);
    if (pool->failed) return false;
    for (int32_t p = 0; p < count; p++) convert(h->packs.batch + p, h->law + p, batch + p, law + p);
    *s = (tm_single_law){{count, h->packs.span, h->packs.alive, batch}, law};
    return true;
}
