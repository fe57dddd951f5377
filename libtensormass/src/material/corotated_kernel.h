/* Correction of a batch of tetrahedra to the linear law, WIDTH lanes at a time. Included once for each instruction set,
 * with TM_NAME(x), TM_TARGET and TM_WIDTH set. No product is fused with a sum, and lanes are independent (iterations
 * skip converged lanes). So all forms are bit-identical, whichever tetrahedra share a batch.
 *
 * The rotation R of F = R S with S symmetric is the proper one, also where F is inverted. With C = F^T F, its
 * invariants I and II, and J = det F, the trace x of S is the largest root of Horn's quartic
 *     (x^2 - I)^2 - 8 J x - 4 II = d,   d = 0,
 * found by Newton's iteration from above (as Theobald does for superpositions), and R is dx/dF = ((x^2 + I + d_I/2) F -
 * 2 F C + (2 x + d_J/4) cof F) / (x (x^2 - I) - 2 J), Hoger and Carlson's closed form.
 *
 * Where the two smaller stretches cancel in an inverted tetrahedron, two roots meet and R jumps. There d(I, J) > 0
 * keeps them apart, so that x is smooth for every F (material_internal.h). The law uses S only through x and its
 * gradient R. So the energy is one smooth function of F and the force its gradient, also under inversion.
 *
 * Over 400 lines: one pass whose parts are inlined, included once for each instruction set. */

#include "material/simd_vector.h"
#ifdef TM_FLOATS
#include "material/single_difference.h"
#endif
#include "material/tet_batch_kernel.h"

/* The batches of a pass, smallest denominators relative to their terms and in total, and the last relative increment of
 * Newton's iteration, which is quadratic. */
#ifdef TM_FLOATS
#define TM_BATCHES tm_single_batches
#define TM_BATCH tm_single_batch
#define TM_BATCHES_OF(all) (all)->single
#define TM_FIBRES tm_single_fibres
#define TM_STRETCHED(b) (b)->H
#define TM_TOGETHER 2 /* batches; and which of these has a lane */
#define TM_PLACE(at) ((at) / TM_LANES)
#define TM_SOUND 1e-6f
#define TM_TINY 1e-30f
#define TM_LAST 1e-4f
#else
#define TM_BATCHES tm_tet_batches
#define TM_BATCH tm_tet_batch
#define TM_BATCHES_OF(all) (all)
#define TM_FIBRES tm_fibre_batch
#define TM_STRETCHED(b) (b)->F
#define TM_TOGETHER 1
#define TM_PLACE(at) 0
#define TM_SOUND 1e-9
#define TM_TINY 1e-300
#define TM_LAST 1e-8
#endif

/* Computes d of the quartic and its derivatives: 0 unless the tetrahedron is nearly flat, for its size, or inverted. */
INSIDE void TM_NAME(parting)(const V8 *I, const V8 *J, V8 *d, V8 *d_I, V8 *d_J) {
    const V8 size = (*I + REAL(TM_CORRECTION_SIZE)) * REAL(1.0 / 3), one = size * 0 + 1;
    const M8 usual = (*J > 0) & (*J * *J >= REAL(TM_CORRECTION_FROM * TM_CORRECTION_FROM) * (size * size * size)),
             near = ~usual;
    *d = *d_I = *d_J = (V8){0};
    if (!TM_NAME(any)(&near)) return;
    V8 root = size;
    TM_NAME(root)(&root);
    const V8 scale = 1 / (size * root), j = *J * scale;
    V8 t = (REAL(TM_CORRECTION_FROM) - j) * REAL(1 / (TM_CORRECTION_FROM - TM_CORRECTION_FULL));
    const M8 whole = t > 1;
    t = (V8)((M8)t & near & (t > 0));
    TM_NAME(choose)(&t, &whole, &one, &t);
    const V8 share = REAL(TM_CORRECTION_MAX) * t * t * t * (10 - t * (15 - 6 * t));
    const V8 slope =
        REAL(-30 * TM_CORRECTION_MAX / (TM_CORRECTION_FROM - TM_CORRECTION_FULL)) * (t * (1 - t)) * (t * (1 - t));
    *d = size * size * share;
    *d_J = size * size * slope * scale;
    *d_I = size * (REAL(2.0 / 3) * share - 0.5 * slope * j);
}

#ifdef TM_FLOATS
#include "material/corotated_polar_single.h"
#else
#include "material/corotated_polar.h"
#endif

/* Finds the largest roots of the quartics of `count` sets of lanes together: one set would wait for the result of each
 * operation. Convergence is quadratic: the first increment below TM_LAST is the last. */
enum { TM_NAME(ITERATIONS) = 24, TM_NAME(SETS) = TM_TOGETHER * TM_LANES / TM_WIDTH };
INSIDE void TM_NAME(find_traces)(TM_NAME(stretch) * s, int count) {
    M8 under_way[TM_NAME(SETS)];
    for (int c = 0; c < count; c++) {
        TM_NAME(above_root)(s + c);
        under_way[c] = s[c].trace == s[c].trace;
    }
    for (int k = 0; k < TM_NAME(ITERATIONS); k++) {
        M8 any = {0};
#pragma GCC unroll 4
        for (int c = 0; c < count; c++) {
            TM_NAME(approach)(s + c, under_way + c);
            any |= under_way[c];
        }
        if (!TM_NAME(any)(&any)) break;
    }
}

#ifndef TM_FLOATS
INSIDE void TM_NAME(polar)(const V8 F[9], V8 R[9], V8 *I, V8 *trace) {
    TM_NAME(stretch) s;
    TM_NAME(measure)(F, &s);
    TM_NAME(find_traces)(&s, 1);
    TM_NAME(rotation_of)(&s, F, R);
    *I = s.I, *trace = s.trace;
}
#endif

/* T = dw/dE of eq. (1). */
typedef struct TM_NAME(law) {
    V8 mu, lambda, dlambda, dmu, beta, a[3];
} TM_NAME(law);
INSIDE void TM_NAME(stress)(const TM_NAME(law) * w, const V8 E[9], V8 T[9]) {
    V8 Ea[3];
    const V8 *a = w->a;
    for (int i = 0; i < 3; i++) Ea[i] = E[3 * i] * a[0] + E[3 * i + 1] * a[1] + E[3 * i + 2] * a[2];
    const V8 I1 = E[0] + E[4] + E[8], I4 = a[0] * Ea[0] + a[1] * Ea[1] + a[2] * Ea[2];
    const V8 sphere = w->lambda * I1 + w->dlambda * I4, along = w->dlambda * I1 + w->beta * I4;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            T[3 * i + j] = 2 * w->mu * E[3 * i + j] + along * a[i] * a[j] + 2 * w->dmu * (a[i] * Ea[j] + Ea[i] * a[j]);
    for (int i = 0; i < 9; i += 4) T[i] += sphere;
}
/* h = t up to `free` either way, constant beyond twice that; its slope falls linearly between. */
INSIDE void TM_NAME(level)(const V8 *t, const V8 *free, V8 *h, V8 *slope) {
    const V8 most = 2 * *free, least = -most, one = *t * 0 + 1, back = -one;
    const M8 above = *t > most, below = *t < least, negative = *t < 0;
    V8 c, sign;
    TM_NAME(choose)(&c, &above, &most, t);
    TM_NAME(choose)(&c, &below, &least, &c);
    TM_NAME(choose)(&sign, &negative, &back, &one);
    V8 over = sign * c - *free;
    over = (V8)((M8)over & (over > 0));
    over /= *free;
    *h = c - sign * over * over * 0.5 * *free;
    *slope = 1 - over;
}

#ifdef TM_FLOATS
/* Ha = H a; and |F a|^2 - 1. */
INSIDE void TM_NAME(along)(const V8 H[9], const V8 a[3], V8 Ha[3]) {
    for (int i = 0; i < 3; i++) Ha[i] = H[3 * i] * a[0] + H[3 * i + 1] * a[1] + H[3 * i + 2] * a[2];
}
INSIDE V8 TM_NAME(square_growth)(const V8 a[3], const V8 Ha[3]) {
    return 2 * (a[0] * Ha[0] + a[1] * Ha[1] + a[2] * Ha[2]) + (Ha[0] * Ha[0] + Ha[1] * Ha[1] + Ha[2] * Ha[2]);
}
#endif
/* Adds the fibre's shear: p = 4 (|C a|^2 - (a.C a)^2) / q^2, q = I + a.C a; P += 2 dmu dp/dF. Below TM_FIBRE_CRUSHED
 * another denominator is used, with the same value and slope there and no zero. */
INSIDE void TM_NAME(fibre_shear)(const TM_NAME(law) * w, const V8 H[9], const V8 F[9], const V8 *I, const V8 g[3],
                                 const V8 *z, V8 P[9], V8 *energy) {
    const V8 *a = w->a;
    V8 Ca[3], FCa[3], square, rise;
    (void)H;
    for (int i = 0; i < 3; i++) Ca[i] = F[i] * g[0] + F[3 + i] * g[1] + F[6 + i] * g[2];
    for (int i = 0; i < 3; i++) FCa[i] = F[3 * i] * Ca[0] + F[3 * i + 1] * Ca[1] + F[3 * i + 2] * Ca[2];
    const V8 q = *I + *z;
#ifdef TM_FLOATS /* |C a - (a.C a) a|^2 */
    V8 N = {0}, Ha[3];
    TM_NAME(along)(H, a, Ha);
    const V8 stretched = TM_NAME(square_growth)(a, Ha);
    for (int i = 0; i < 3; i++) {
        const V8 across = Ha[i] + (H[i] * g[0] + H[3 + i] * g[1] + H[6 + i] * g[2]) - stretched * a[i];
        N += across * across;
    }
#else
    const V8 N = Ca[0] * Ca[0] + Ca[1] * Ca[1] + Ca[2] * Ca[2] - *z * *z;
#endif
    const V8 c2 = q * 0 + REAL(TM_FIBRE_CRUSHED * TM_FIBRE_CRUSHED), sum = c2 + q * q;
    const V8 far = q * q, twice = 2 * q, low = sum * sum / (4 * c2), slow = sum * q / c2;
    const M8 crushed = q < TM_FIBRE_CRUSHED;
    TM_NAME(choose)(&square, &crushed, &low, &far);
    TM_NAME(choose)(&rise, &crushed, &slow, &twice);
    const V8 over = 1 / square, p = 4 * N * over, m = 16 * w->dmu * over, r = 4 * w->dmu * p * rise * over;
    *energy += 2 * w->dmu * p;
    for (int i = 0; i < 3; i++) {
        const V8 along = m * (FCa[i] - 2 * *z * g[i]) - r * g[i];
        for (int j = 0; j < 3; j++) P[3 * i + j] += m * g[i] * Ca[j] + along * a[j] - r * F[3 * i + j];
    }
}

/* Computes the complete addition of fibres to the isotropic law. It depends on their elongation e = |F a| - 1, the
 * change of volume x - 3 and their shear, so that R is the only rotation it needs:
 *     dlambda level(x - 3) level(e) + (beta + 4 dmu) (e^2/2, linear beyond TM_FIBRE_FREE) + 2 dmu p.
 * Where lambda is negative, its tension ends at TM_FIBRE_FREE. To second order in small strains it equals eq. (1). */
INSIDE void TM_NAME(fibred)(const TM_NAME(law) * w, const V8 H[9], const V8 F[9], const V8 R[9], const V8 *I,
                            const V8 *growth, V8 P[9], V8 *energy) {
    const V8 *a = w->a;
    V8 g[3], level_x, slope_x, level_e, slope_e, length, over;
    for (int i = 0; i < 3; i++) g[i] = F[3 * i] * a[0] + F[3 * i + 1] * a[1] + F[3 * i + 2] * a[2];
#ifdef TM_FLOATS
    V8 Ha[3];
    TM_NAME(along)(H, a, Ha);
    const V8 longer = TM_NAME(square_growth)(a, Ha), z = longer + 1, one = z * 0 + 1;
#else
    const V8 z = g[0] * g[0] + g[1] * g[1] + g[2] * g[2], one = z * 0 + 1;
#endif
    V8 root = z;
    TM_NAME(root)(&root);
    const V8 least = one * REAL(TM_FIBRE_SHORT), low = z * REAL(0.5 / TM_FIBRE_SHORT) + REAL(0.5 * TM_FIBRE_SHORT);
    const M8 shrunk = root < least; /* the length has a kink at 0 */
    TM_NAME(choose)(&length, &shrunk, &low, &root);
    TM_NAME(choose)(&over, &shrunk, &least, &root);
#ifdef TM_FLOATS
    V8 e = longer / (root + 1);
    const V8 shortened = length - 1;
    TM_NAME(choose)(&e, &shrunk, &shortened, &e);
#else
    const V8 e = length - 1;
#endif
    const V8 grown = *growth, free = one * TM_FIBRE_FREE, stiff = w->beta + 4 * w->dmu;
    const M8 taut = e > free, outward = w->lambda < 0;
    TM_NAME(level)(&grown, &free, &level_x, &slope_x);
    TM_NAME(level)(&e, &free, &level_e, &slope_e);
    V8 pull, beyond = grown - free;
    TM_NAME(choose)(&pull, &taut, &free, &e);
    beyond = (V8)((M8)beyond & (beyond > 0));
    const V8 fixed = (V8)((M8)(-w->lambda) & outward);
    const V8 of_x = w->dlambda * slope_x * level_e + fixed * beyond;
    const V8 of_e = (w->dlambda * level_x * slope_e + stiff * pull) / over;
    *energy = w->dlambda * level_x * level_e + stiff * pull * (e - 0.5 * pull) + 0.5 * fixed * beyond * beyond;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) P[3 * i + j] = of_x * R[3 * i + j] + of_e * g[i] * a[j];
#ifdef TM_FLOATS
    for (int i = 0; i < 9; i += 4) P[i] += of_x;
#endif
    TM_NAME(fibre_shear)(w, H, F, I, g, &z, P, energy);
}

/* Isotropic law. The polar rotation has the least energy as long as the tension of the volume is below twice mu; the
 * tension is limited to that or a fifth of lambda. Stress and energy are without those of the linear law: 2 mu (F - R)
 * + p R - mu (H + H^T) - lambda tr H = mu (H - H^T) + (2 mu - lambda tr H) + (p - 2 mu) R. */
INSIDE void TM_NAME(isotropic)(const V8 *mu, const V8 *lambda, const V8 H[9], const V8 R[9], const V8 *grown,
                               V8 *pressure, V8 add[9]) {
    const V8 twice = 2 * *mu, fifth = REAL(0.2) * *lambda, diagonal = twice - *lambda * (H[0] + H[4] + H[8]);
    const M8 stiff = fifth > twice;
    V8 most;
    TM_NAME(choose)(&most, &stiff, &fifth, &twice);
    *pressure = *lambda * *grown;
    const M8 over = *pressure > most;
    TM_NAME(choose)(pressure, &over, &most, pressure);
    const V8 turn = *pressure - twice;
#ifdef TM_FLOATS /* the same without large terms that cancel */
    const V8 second = *pressure - (twice - diagonal);
    for (int i = 0; i < 9; i++) add[i] = i % 4 ? turn * R[i] : turn * R[i] + second;
#else
    for (int i = 0; i < 9; i++) add[i] = turn * R[i];
    for (int i = 0; i < 9; i += 4) add[i] += diagonal;
#endif
    for (int i = 0; i < 2; i++)
        for (int j = i + 1; j < 3; j++) {
            const V8 spin = *mu * (H[3 * i + j] - H[3 * j + i]);
            add[3 * i + j] += spin, add[3 * j + i] -= spin;
        }
}

/* Subtracts stress and energy of the linear law's fibre terms. */
INSIDE void TM_NAME(take_linear)(const TM_NAME(law) * w, const V8 H[9], V8 P[9], V8 *energy) {
    TM_NAME(law) fibres = *w;
    V8 sum = {0}, E[9], T[9];
    fibres.mu = fibres.lambda = (V8){0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) E[3 * i + j] = 0.5 * (H[3 * i + j] + H[3 * j + i]);
    TM_NAME(stress)(&fibres, E, T);
    for (int i = 0; i < 9; i++) sum += E[i] * T[i];
    for (int i = 0; i < 9; i++) P[i] -= T[i];
    *energy -= 0.5 * sum;
}

/* Reads the batch's law; returns false if it is isotropic. */
INSIDE bool TM_NAME(law_of)(const TM_BATCHES *batches, int32_t p, int at, TM_NAME(law) * w) {
    memcpy(&w->mu, batches->batch[p].mu_J + at, sizeof(V8));
    memcpy(&w->lambda, batches->batch[p].lambda_J + at, sizeof(V8));
    if (!batches->fibred_of || batches->fibred_of[p] < 0) return false;
    const TM_FIBRES *f = batches->fibred + batches->fibred_of[p];
    memcpy(&w->dlambda, f->dlambda_J + at, sizeof(V8));
    memcpy(&w->dmu, f->dmu_J + at, sizeof(V8));
    memcpy(&w->beta, f->beta_J + at, sizeof(V8));
    for (int i = 0; i < 3; i++) memcpy(&w->a[i], f->fibre[i] + at, sizeof(V8));
    return true;
}

/* Computes the blend: 0 below the threshold, 1 above the band. Between them it is the polynomial whose first two
 * derivatives vanish at both ends. slope: its derivative by |H|^2. Returns false if all are 0. */
INSIDE bool TM_NAME(blend)(const TM_BATCHES *batches, const V8 H[9], V8 *weight, V8 *slope) {
    V8 s = {0};
    for (int i = 0; i < 9; i++) s += H[i] * H[i];
    const V8 one = s * 0 + 1;
    V8 x = (s - batches->begin_1_2) * (1 / batches->width_1_2);
    const M8 above = x > 0, beyond = x > 1, within = ~beyond;
    if (!TM_NAME(any)(&within)) {
        *weight = one, *slope = (V8){0};
        return true;
    }
    x = (V8)((M8)x & above);
    TM_NAME(choose)(&x, &beyond, &one, &x);
    *weight = x * x * x * (10 - x * (15 - 6 * x));
    *slope = 30 * (x * (1 - x)) * (x * (1 - x)) * (1 / batches->width_1_2);
    return TM_NAME(any)(&above);
}

/* Correction of a batch: stress and, where requested or needed, energy; both before multiplication by the weight. */
typedef struct TM_NAME(turned) {
    V8 H[9], F[9], R[9], trace, I; /* the polar rotation, in single less 1, and the trace of its stretch */
    V8 growth, bent;               /* trace - 3; of single precision, that less tr H */
    V8 stress[9], energy, weight, slope;
} TM_NAME(turned);
INSIDE void TM_NAME(deform)(TM_NAME(turned) * b) {
    for (int i = 0; i < 9; i++) b->F[i] = b->H[i] + REAL(i % 4 ? 0.0 : 1.0);
}
#ifdef TM_FLOATS
/* Sums of terms of second order. */
INSIDE void TM_NAME(isotropic_energy)(const V8 *mu, const V8 *lambda, const TM_NAME(turned) * b, const V8 *pressure,
                                      V8 *energy) {
    const V8 *H = b->H, sphere = H[0] + H[4] + H[8], uncapped = *lambda * b->growth;
    const V8 yz = H[5] - H[7], zx = H[2] - H[6], xy = H[1] - H[3];
    V8 stored = 0.5 * *lambda * b->bent * (b->growth + sphere);
    const M8 over = uncapped > *pressure;
    const V8 beyond = *pressure * (b->growth - 0.5 * *pressure / *lambda) - 0.5 * *lambda * sphere * sphere;
    TM_NAME(choose)(&stored, &over, &beyond, &stored);
    *energy = *mu * (0.5 * (yz * yz + zx * zx + xy * xy) - 2 * b->bent) + stored;
}
#else
INSIDE void TM_NAME(isotropic_energy)(const V8 *mu, const V8 *lambda, const TM_NAME(turned) * b, const V8 *pressure,
                                      V8 *energy) {
    const V8 *H = b->H, grown = b->growth, uncapped = *lambda * grown, sphere = H[0] + H[4] + H[8];
    V8 stored = 0.5 * uncapped * grown, straight = 0.5 * *lambda * sphere * sphere;
    const M8 over = uncapped > *pressure;
    const V8 beyond = *pressure * (grown - 0.5 * *pressure / *lambda);
    TM_NAME(choose)(&stored, &over, &beyond, &stored);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) straight += 0.5 * *mu * (H[3 * i + j] + H[3 * j + i]) * H[3 * i + j];
    *energy = *mu * (b->I - 2 * b->trace + 3) + stored - straight;
}
#endif
INSIDE void TM_NAME(turn_law)(const TM_NAME(law) * w, bool fibred, bool wants_energy, TM_NAME(turned) * b) {
    V8 pressure;
    TM_NAME(isotropic)(&w->mu, &w->lambda, b->H, b->R, &b->growth, &pressure, b->stress);
    const M8 steep = b->slope != 0;
    wants_energy = wants_energy || TM_NAME(any)(&steep);
    b->energy = (V8){0};
    if (wants_energy) TM_NAME(isotropic_energy)(&w->mu, &w->lambda, b, &pressure, &b->energy);
    if (!fibred) return;
    V8 P[9], energy; /* some lanes may be isotropic */
    const M8 has = (w->dlambda != 0) | (w->dmu != 0) | (w->beta != 0);
    TM_NAME(fibred)(w, b->H, b->F, b->R, &b->I, &b->growth, P, &energy);
    TM_NAME(take_linear)(w, b->H, P, &energy);
    b->energy += (V8)((M8)energy & has);
    for (int i = 0; i < 9; i++) b->stress[i] += (V8)((M8)P[i] & has);
}
#ifndef TM_FLOATS
INSIDE void TM_NAME(straighten)(TM_NAME(turned) * b) {
    TM_NAME(deform)(b);
    TM_NAME(polar)(b->F, b->R, &b->I, &b->trace);
    b->growth = b->trace - 3;
}
INSIDE bool TM_NAME(turn)(const tm_tet_batches *batches, int32_t p, int at, const double *u, bool wants_energy,
                          TM_NAME(turned) * b) {
    TM_NAME(law) w;
    TM_NAME(gradient)(batches, p, at, u, b->H);
    if (!TM_NAME(blend)(batches, b->H, &b->weight, &b->slope)) return false;
    const bool fibred = TM_NAME(law_of)(batches, p, at, &w);
    TM_NAME(straighten)(b);
    TM_NAME(turn_law)(&w, fibred, wants_energy, b);
    return true;
}
#endif

/* The same of a complete batch. Returns how many sets of lanes have a correction; at: their first lanes. */
INSIDE int TM_NAME(turn_all)(const TM_BATCHES *batches, const int32_t *list, int many, const double *u,
                             bool wants_energy, TM_NAME(turned) * turned, int *at) {
    TM_NAME(stretch) stretch[TM_NAME(SETS)];
    int count = 0;
    for (int l = 0; l < TM_LANES * many; l += TM_WIDTH) {
        TM_NAME(turned) *b = turned + count;
        TM_NAME(gradient)(batches, list[TM_PLACE(l)], l % TM_LANES, u, b->H);
        if (!TM_NAME(blend)(batches, b->H, &b->weight, &b->slope)) continue;
        TM_NAME(deform)(b);
        TM_NAME(measure)(TM_STRETCHED(b), stretch + count);
        at[count++] = l;
    }
    if (count == TM_NAME(SETS)) /* the usual case, with a number that the compiler knows */
        TM_NAME(find_traces)(stretch, TM_NAME(SETS));
    else
        TM_NAME(find_traces)(stretch, count);
    for (int c = 0; c < count; c++) {
        TM_NAME(turned) *b = turned + c;
        TM_NAME(law) w;
        const bool fibred = TM_NAME(law_of)(batches, list[TM_PLACE(at[c])], at[c] % TM_LANES, &w);
        TM_NAME(rotation_of)(stretch + c, TM_STRETCHED(b), b->R);
        b->I = stretch[c].I, b->trace = stretch[c].trace, b->growth = TM_NAME(growth)(stretch + c);
#ifdef TM_FLOATS
        b->bent = stretch[c].bent;
#endif
        TM_NAME(turn_law)(&w, fibred, wants_energy, b);
    }
    return count;
}

/* Adds the corner forces to force_N, the marked lanes ascending. */
INSIDE void TM_NAME(scatter)(const TM_BATCHES *batches, int32_t p, int at, const M8 *who, const V8 P[9],
                             double *force_N) {
    const TM_BATCH *batch = batches->batch + p;
    V8 pulls[4][3];
    TM_NAME(two) xy[4][TM_WIDTH];
    double z[4][TM_WIDTH] __attribute__((aligned(64)));
    TM_NAME(pull)(batches, p, at, P, pulls);
    for (int k = 0; k < 4; k++) {
        TM_NAME(pairs)(&pulls[k][0], &pulls[k][1], xy[k]);
        TM_NAME(store_wide)(&pulls[k][2], z[k]);
    }
    for (int l = 0; l < TM_WIDTH; l++) {
        if (!(*who)[l]) continue;
        for (int k = 0; k < 4; k++) { /* two stores instead of three */
            double *of = force_N + batch->component[k][at + l];
            TM_NAME(two) sum;
            memcpy(&sum, of, sizeof sum);
            sum -= xy[k][l];
            memcpy(of, &sum, sizeof sum);
            of[2] -= z[k][l];
        }
    }
}

INSIDE void TM_NAME(stress_of)(const TM_NAME(turned) * b, V8 P[9]) {
    const M8 within = (b->weight != 1) | (b->slope != 0);
    const V8 steer = 2 * b->slope * b->energy;
    if (!TM_NAME(any)(&within))
        memcpy(P, b->stress, sizeof b->stress);
    else
        for (int i = 0; i < 9; i++) P[i] = b->weight * b->stress[i] + steer * b->H[i];
}

/* Adds the energies of lanes in ascending order: the same bits for every width. */
INSIDE void TM_NAME(add_energy)(const TM_NAME(turned) * b, double *sum_J) {
    const V8 weighted = (V8)((M8)(b->weight * b->energy) & (b->weight > 0));
    for (int l = 0; l < TM_WIDTH; l++) *sum_J += (double)weighted[l];
}

TM_TARGET static int32_t TM_NAME(force)(const tm_tet_batches *all, const int32_t *list, int32_t count,
                                        const double *u_m, double *force_N, double *energy_J) {
    const TM_BATCHES *batches = TM_BATCHES_OF(all);
    int32_t active = 0;
    for (int32_t n = 0; n < count; n += TM_TOGETHER) {
        TM_NAME(turned) b[TM_NAME(SETS)];
        int at[TM_NAME(SETS)];
        const int many = n + TM_TOGETHER <= count ? TM_TOGETHER : 1;
        const int sets = TM_NAME(turn_all)(batches, list + n, many, u_m, energy_J, b, at);
        double sum_J[TM_TOGETHER] = {0};
        bool any[TM_TOGETHER] = {false};
        for (int c = 0; c < sets; c++) {
            V8 P[9];
            const M8 who = b[c].weight > 0;
            const int k = TM_PLACE(at[c]);
            TM_NAME(stress_of)(b + c, P);
            TM_NAME(scatter)(batches, list[n + k], at[c] % TM_LANES, &who, P, force_N);
            if (energy_J) TM_NAME(add_energy)(b + c, sum_J + k);
            any[k] = true;
        }
        for (int k = 0; k < many; k++) {
            if (energy_J) energy_J[n + k] = sum_J[k];
            active += any[k];
        }
    }
    return active;
}
#include "material/corner_force_kernel.h"
#ifndef TM_FLOATS
#include "material/nodal_dilatation_kernel.h"
#include "material/viscous_kernel.h"
#endif
#undef TM_BATCHES
#undef TM_BATCH
#undef TM_BATCHES_OF
#undef TM_FIBRES
#undef TM_STRETCHED
#undef TM_TOGETHER
#undef TM_PLACE
#undef TM_SOUND
#undef TM_TINY
#undef TM_LAST
#undef V8
#undef M8
#undef INSIDE
#undef REAL
