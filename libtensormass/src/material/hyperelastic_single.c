/* Forms of the single-precision pass of nonlinear laws, and its batches. */
#include "material/hyperelastic_single.h"

#include <math.h>
#include <string.h>

#define TM_KERNEL "material/hyperelastic_single_pass.h"
#define TM_FORM(form, x) tm_single_##form##_##x
#include "material/single_forms.h"

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

static void convert(const tm_law_pack *law, tm_single_laws *l) {
    tm_narrow(law->I3_max, TM_LANES, l->I3_max);
    tm_narrow(law->constant[0], TM_LAW_CONSTANTS * TM_LANES, l->constant[0]);
    tm_narrow(law->dlambda_J, TM_LANES, l->dlambda_J);
    tm_narrow(law->dmu_J, TM_LANES, l->dmu_J);
    tm_narrow(law->beta_J, TM_LANES, l->beta_J);
    tm_narrow(law->fibre[0], 3 * TM_LANES, l->fibre[0]);
    for (int i = 0; i < TM_LANES; i++) l->law[i] = (int32_t)law->law[i];
    l->laws = law->laws;
}

bool tm_single_law_init(tm_single_law *s, tm_pool *pool, const tm_hyperelastic *h) {
    const int32_t count = h->packs.count;
    const tm_single_batch *batch = tm_single_batch_take(pool, &h->packs);
    tm_single_laws *law = TM_ALLOC(pool, tm_single_laws, count);
    if (pool->failed) return false;
    for (int32_t p = 0; p < count; p++) convert(h->law + p, law + p);
    *s = (tm_single_law){{.count = count, .span = h->packs.span, .alive = h->packs.alive, .batch = batch}, law};
    return true;
}
