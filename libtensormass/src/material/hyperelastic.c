/* Nonlinear laws: forms of their kernel, energies, and tangents by the complex step. */
#include "material/hyperelastic.h"

#include <complex.h>
#undef I
#include <math.h>
#include <string.h>

#include "base/intrinsics.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors never cross a call: every function that takes them is inlined */

#define TM_NAME(x) tm_plain_##x
#define TM_TARGET
#define TM_WIDTH 2
#define TM_ENERGIES
#include "material/hyperelastic_pass.h"
#undef TM_ENERGIES
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#ifdef TM_HAS_AVX2
#define TM_NAME(x) tm_avx2_##x
#define TM_TARGET __attribute__((target("avx2")))
#define TM_WIDTH 4
#include "material/hyperelastic_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#define TM_NAME(x) tm_avx512_##x
#define TM_TARGET __attribute__((target("avx512f,avx512dq,avx512vl")))
#define TM_WIDTH 8
#include "material/hyperelastic_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#endif

#ifdef TM_HAS_NEON
#define TM_NEON_FORM
#define TM_NAME(x) tm_neon_##x
#define TM_TARGET
#define TM_WIDTH 2
#include "material/hyperelastic_pass.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#undef TM_NEON_FORM
#endif

#define TM_NAME(x) tm_complex_##x
#define TM_TARGET
#include "material/complex_lane.h"

#include "material/hyperelastic_kernel.h"
#undef V8
#undef M8
#undef INSIDE
#undef REAL
#undef TM_NAME
#undef TM_TARGET

tm_hyper_force tm_hyper_force_form(int form) {
#ifdef TM_HAS_AVX2
    if (form == 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return tm_avx512_hyper_force;
    if (form == 1 && __builtin_cpu_supports("avx2")) return tm_avx2_hyper_force;
#endif
#ifdef TM_HAS_NEON
    if (form == 1) return tm_neon_hyper_force;
#endif
    return form == 0 ? tm_plain_hyper_force : NULL;
}

tm_hyper_force tm_hyper_force_choose(bool plain) {
    int form = plain ? 0 : 2;
    while (!tm_hyper_force_form(form)) form--;
    return tm_hyper_force_form(form);
}

tm_hyper_strain tm_hyper_strain_choose(bool plain) {
    const tm_hyper_force form = tm_hyper_force_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_hyper_force) return tm_avx512_hyper_strain;
    if (form == tm_avx2_hyper_force) return tm_avx2_hyper_strain;
#endif
#ifdef TM_HAS_NEON
    if (form == tm_neon_hyper_force) return tm_neon_hyper_strain;
#endif
    (void)form;
    return tm_plain_hyper_strain;
}

tm_hyper_green tm_hyper_green_choose(bool plain) {
    const tm_hyper_force form = tm_hyper_force_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_hyper_force) return tm_avx512_hyper_green;
    if (form == tm_avx2_hyper_force) return tm_avx2_hyper_green;
#endif
#ifdef TM_HAS_NEON
    if (form == tm_neon_hyper_force) return tm_neon_hyper_green;
#endif
    (void)form;
    return tm_plain_hyper_green;
}

void tm_hyperelastic_evaluate(const tm_hyperelastic *h, const tm_viscous *v, const tm_nodal_dilatation *averages,
                              bool plain, const double *u_m) {
    tm_viscous elastic = *v;
    elastic.terms = 0;
    tm_hyper_strain_choose(plain)(h, &elastic, averages, 0, h->packs.count, u_m);
    if (h->averaged) tm_nodal_dilatation_average(averages, NULL, 0, tm_nodal_dilatation_domains(averages));
}

void tm_hyperelastic_corners(const tm_hyperelastic *h, const tm_viscous *v, const tm_nodal_dilatation *averages,
                             bool plain, const double *u_m) {
    if (!h->averaged && !h->bulk_J) {
        tm_hyper_force_choose(plain)(h, 0, h->packs.count, u_m, v->corner_N);
        return;
    }
    tm_hyperelastic_evaluate(h, v, averages, plain, u_m);
    if (h->averaged) tm_viscous_choose(plain).pressure(&h->packs, v, averages, 0, h->packs.count);
}

/* --- batches --- */

static const double NO_LIMIT = 1e300;

static void fill(const tm_material_field *field, int32_t tet, tm_law_pack *batch, int l) {
    const tm_material *m = tm_field_material(field, tet);
    const double *a = tm_field_fibre(field, tet), s = m->stretch_max;
    batch->law[l] = m->law;
    batch->laws |= 1u << m->law;
    /* For a uniaxial stretch s that keeps the volume. */
    batch->I3_max[l] = m->law == TM_LAW_LINEAR ? NO_LIMIT : s * s + 2 / s - 3;
    const double volume = field->mesh->volume_m3[tet];
    double c[TM_LAW_CONSTANTS];
    tm_law_constants(m, volume, c);
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) batch->constant[i][l] = c[i];
    batch->dlambda_J[l] = volume * m->dlambda_Pa, batch->dmu_J[l] = volume * m->dmu_Pa;
    batch->beta_J[l] = volume * m->beta_Pa;
    for (int i = 0; i < 3; i++) batch->fibre[i][l] = a ? a[i] : 0;
}

bool tm_hyperelastic_take(tm_hyperelastic *h, tm_pool *pool, const tm_material_field *field) {
    *h = (tm_hyperelastic){.averaged = field->smoothed, .shear = 1, .volume = 1};
    if (!tm_tet_batches_init(&h->packs, pool, field)) return false;
    tm_law_pack *law = TM_ALLOC(pool, tm_law_pack, h->packs.count);
    if (!law) return false;
    for (int32_t p = 0; p < h->packs.count; p++)
        for (int l = 0; l < TM_LANES; l++) {
            if (TM_LANES * p + l < field->mesh->tet_count)
                fill(field, TM_LANES * p + l, law + p, l);
            else
                law[p].I3_max[l] = NO_LIMIT;
        }
    h->law = law;
    return true;
}

/* --- energy --- */

static double energy_of(int64_t law, const tm_plain_hyper *w, const tm_plain_v8 H[9], const tm_plain_strain *s,
                        int lane) {
    switch (law) {
    case TM_LAW_LINEAR: return tm_plain_linear_energy(w, H, s, lane);
#define TM_ENERGY(NAME, name)                                                                                          \
    case TM_LAW_##NAME: return tm_plain_##name##_energy(w, H, s, lane);
        TM_NONLINEAR_LAWS(TM_ENERGY)
#undef TM_ENERGY
    default: return 0;
    }
}

double tm_hyperelastic_tet_energy(const tm_hyperelastic *h, int32_t tet, const double *u_m) {
    const int32_t p = tet / TM_LANES;
    const int at = tet % TM_LANES / 2 * 2, l = tet % 2;
    tm_plain_v8 H[9];
    tm_plain_hyper w;
    tm_plain_strain s;
    tm_plain_beyond b;
    tm_plain_gradient(&h->packs, p, at, u_m, H);
    tm_plain_hyper_of(h, p, at, &w);
    tm_plain_strain_of(H, &s);
    b.who = tm_plain_exceeds(&s.I3, &w.I3_max);
    double spring_J = 0;
    if (b.who[l]) {
        tm_plain_scale_back(&w, &s.I3, H, &b);
        tm_plain_strain_of(H, &s);
        spring_J = 2.0 / 3 * w.mu[l] * b.excess[l] * b.excess[l];
    }
    const int64_t law = h->law[p].law[tet % TM_LANES];
    const double own_J = energy_of(law, &w, H, &s, l) + spring_J;
    if (!h->bulk_J) return own_J;
    const double grown = law == TM_LAW_LINEAR ? s.trace[l] : s.J1[l], most = TM_VOLUME_MOST - 1;
    const double within = law == TM_LAW_LINEAR ? grown : fmin(fmax(grown, TM_VOLUME_LEAST - 1), most);
    return h->shear * own_J + (h->volume - h->shear) * h->bulk_J[tet] * within * (grown - 0.5 * within);
}

double tm_hyperelastic_energy(const tm_hyperelastic *h, const double *u_m) {
    double sum = 0;
    for (int32_t t = 0; t < h->packs.tet_count; t++)
        if (h->packs.alive[t]) sum += tm_hyperelastic_tet_energy(h, t, u_m);
    return sum;
}

/* --- tangent --- */

/* Computes the derivative of the stress, or of the dilatation's slope. */
static void differentiate(int64_t law, const tm_complex_hyper *w, const double H[9], bool dilatation, double A[81]) {
    static const double step = 1e-100;
    for (int k = 0; k < 9; k++) {
        double _Complex at[9], P[9], grown;
        int64_t outside;
        for (int i = 0; i < 9; i++) at[i] = H[i] + (i == k ? step : 0) * _Complex_I;
        if (dilatation)
            tm_complex_dilatation(law, w, at, &grown, P);
        else
            tm_complex_hyper_stress(law, w, at, P, &outside);
        for (int i = 0; i < 9; i++) A[9 * i + k] = cimag(P[i]) / step;
    }
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < i; j++) A[9 * i + j] = A[9 * j + i] = 0.5 * (A[9 * i + j] + A[9 * j + i]);
}

static void differentiate_tet(const tm_hyperelastic *h, int32_t tet, const double *u_m, bool dilatation, double A[81]) {
    const int32_t p = tet / TM_LANES;
    const int at = tet % TM_LANES / 2 * 2, l = tet % 2;
    tm_plain_v8 gradient[9];
    tm_plain_hyper w;
    double H[9];
    tm_plain_gradient(&h->packs, p, at, u_m, gradient);
    tm_plain_hyper_of(h, p, at, &w);
    tm_complex_hyper one = {.mu = w.mu[l],
                            .lambda = w.lambda[l],
                            .dlambda = w.dlambda[l],
                            .dmu = w.dmu[l],
                            .beta = w.beta[l],
                            .I3_max = w.I3_max[l]};
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) one.c[i] = w.c[i][l];
    for (int i = 0; i < 3; i++) one.fibre[i] = w.fibre[i][l];
    for (int i = 0; i < 9; i++) H[i] = gradient[i][l];
    differentiate(h->law[p].law[tet % TM_LANES], &one, H, dilatation, A);
}

/* A := the share of the law, and that of its bulk modulus. */
static void share_out(const tm_hyperelastic *h, int32_t tet, const double *u_m, double A[81]) {
    const int32_t p = tet / TM_LANES;
    const int at = tet % TM_LANES / 2 * 2, l = tet % 2;
    const bool linear = h->law[p].law[tet % TM_LANES] == TM_LAW_LINEAR;
    tm_plain_v8 H[9], slope[9], grown;
    tm_plain_hyper w;
    double bend[81];
    tm_plain_gradient(&h->packs, p, at, u_m, H);
    tm_plain_hyper_of(h, p, at, &w);
    tm_plain_dilatation(linear ? TM_LAW_LINEAR : TM_LAW_NEO_HOOKE, &w, H, &grown, slope);
    tm_hyperelastic_dilatation_hessian(h, tet, u_m, bend);
    const double J1 = grown[l], bulk_J = (h->volume - h->shear) * h->bulk_J[tet];
    const double within = linear ? J1 : fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    for (int i = 0; i < 81; i++) {
        A[i] = h->shear * A[i] + bulk_J * within * bend[i];
        if (within == J1) A[i] += bulk_J * slope[i / 9][l] * slope[i % 9][l];
    }
}

void tm_hyperelastic_hessian(const tm_hyperelastic *h, int32_t tet, const double *u_m, double A[81]) {
    differentiate_tet(h, tet, u_m, false, A);
    if (h->bulk_J) share_out(h, tet, u_m, A);
}

void tm_hyperelastic_dilatation_hessian(const tm_hyperelastic *h, int32_t tet, const double *u_m, double A[81]) {
    differentiate_tet(h, tet, u_m, true, A);
}

void tm_hyperelastic_add_bend(const tm_hyperelastic *h, const tm_nodal_dilatation *averages, int32_t tet,
                              const double *u_m, double A[81]) {
    double bend[81], pressure = 0;
    for (int k = 0; k < 4; k++) pressure += averages->corotated_Pa[averages->domain[4 * (int64_t)tet + k]];
    tm_hyperelastic_dilatation_hessian(h, tet, u_m, bend);
    for (int i = 0; i < 81; i++) A[i] += averages->quarter_m3[tet] * pressure * bend[i];
}
