/* Passes of nonlinear laws over batches; a part of hyperelastic.c, for real numbers. */

#include "material/simd_vector.h"

#include "material/tet_batch_kernel.h"

#include "material/hyperelastic_kernel.h"

#include "material/hyperelastic_batch.h"

/* Computes the dilatation of each lane and its derivative by F. */
INSIDE void TM_NAME(batch_dilatation)(const tm_hyperelastic *h, int32_t p, int at, const TM_NAME(hyper) * w,
                                      const V8 H[9], V8 *grown, V8 slope[9]) {
    V8 straight, unit[9];
    M8 linear = {0};
    TM_NAME(dilatation)(TM_LAW_NEO_HOOKE, w, H, grown, slope);
    if (!(h->law[p].laws >> TM_LAW_LINEAR & 1)) return;
    TM_NAME(dilatation)(TM_LAW_LINEAR, w, H, &straight, unit);
    for (int l = 0; l < TM_WIDTH; l++) linear[l] = h->law[p].law[at + l] == TM_LAW_LINEAR ? -1 : 0;
    TM_NAME(choose)(grown, &linear, &straight, grown);
    for (int i = 0; i < 9; i++) TM_NAME(choose)(&slope[i], &linear, &unit[i], &slope[i]);
}

#include "material/hyperelastic_terms.h"

INSIDE void TM_NAME(store_corners)(const tm_hyperelastic *h, int32_t p, int at, const M8 *there, const V8 P[9],
                                   double *corner_N) {
    V8 f[4][3];
    TM_NAME(pull)(&h->packs, p, at, P, f);
    for (int i = 0; i < 12; i++) {
        const V8 kept = (V8)((M8)f[i / 3][i % 3] & *there);
        memcpy(corner_N + 12 * TM_LANES * (int64_t)p + TM_LANES * i + at, &kept, sizeof kept);
    }
}

/* Stresses with long-term shares and terms. With averaged dilatation they are those of the rest of the law, and
 * dilatations with their derivatives follow, for tm_nodal_dilatation_average and the pass over pressures
 * (viscous_kernel.h); without, corner forces. */
TM_TARGET static int32_t TM_NAME(hyper_strain)(const tm_hyperelastic *h, const tm_viscous *v,
                                               const tm_nodal_dilatation *s, int32_t begin, int32_t end,
                                               const double *u_m) {
    int32_t count = 0;
    for (int32_t p = begin; p < end; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 H[9], P[9], slope[9], grown, quarter;
            M8 outside, there;
            TM_NAME(hyper) w;
            TM_NAME(gradient)(&h->packs, p, at, u_m, H);
            TM_NAME(hyper_of)(h, p, at, &w);
            TM_NAME(batch_stress)(h, p, at, H, P, &outside);
            TM_NAME(batch_dilatation)(h, p, at, &w, H, &grown, slope);
            TM_NAME(active_lanes)(&h->packs, p, at, &there);
            if (h->bulk_J) TM_NAME(relax_stress)(h, v, p, at, &grown, slope, H, P);
            if (!h->averaged) {
                TM_NAME(store_corners)(h, p, at, &there, P, v->corner_N);
            } else {
                memcpy(&quarter, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof quarter);
                grown = (V8)((M8)(quarter * grown) & there);
                memcpy(s->dilatation + TM_LANES * (int64_t)p + at, &grown, sizeof grown);
                for (int i = 0; i < 9; i++) {
                    const int64_t to = (9 * (int64_t)p + i) * TM_LANES + at;
                    memcpy(s->rotation + to, &slope[i], sizeof(V8));
                    memcpy(v->stress_J + to, &P[i], sizeof(V8));
                }
            }
            if (TM_NAME(any)(&outside))
                for (int l = 0; l < TM_WIDTH; l++) count += outside[l] != 0;
        }
    return count;
}

#define TM_BATCHES tm_hyperelastic
#include "material/hyperelastic_force.h"

/* most[p] := largest |E|^2 of the batch, E Green's strain; infinite where a tetrahedron is inside out. */
TM_TARGET static void TM_NAME(hyper_green)(const tm_hyperelastic *h, int32_t begin, int32_t end, const double *u_m,
                                           double *most) {
    for (int32_t p = begin; p < end; p++) {
        most[p] = 0;
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 H[9], E[9], square, zero = {0}, far = zero + HUGE_VAL;
            TM_NAME(strain) s;
            TM_NAME(gradient)(&h->packs, p, at, u_m, H);
            TM_NAME(green_strain)(H, E);
            TM_NAME(strain_of)(H, &s);
            square = E[0] * E[0];
            for (int i = 1; i < 9; i++) square += E[i] * E[i];
            const V8 det = s.J1 + 1.0;
            const M8 inverted = TM_NAME(exceeds)(&zero, &det);
            TM_NAME(choose)(&square, &inverted, &far, &square);
            for (int l = 0; l < TM_WIDTH; l++)
                if (!(square[l] <= most[p])) most[p] = square[l] >= 0 ? square[l] : HUGE_VAL; /* not a number */
        }
    }
}
#undef V8
#undef M8
#undef INSIDE
#undef REAL
