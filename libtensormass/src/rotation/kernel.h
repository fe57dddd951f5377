/* What a pack of tetrahedra adds to the linear law, WIDTH lanes at a time; included once for each set of instructions,
 * with TM_NAME(x), TM_TARGET and TM_WIDTH set. No product is fused with a sum and every lane is on its own (iterations
 * leave alone who has arrived), so that all forms give the same bits, whoever shares a pack.
 *
 * The rotation R of F = R S with S symmetric is the proper one, also where F is inside out. With C = F^T F, its
 * invariants I and II, and J = det F, the trace x of S is the largest root of Horn's quartic
 *     (x^2 - I)^2 - 8 J x - 4 II = 0,
 * found by Newton's iteration from sqrt(3 I), which is never below it (as Theobald does for superpositions), and R is
 * dx/dF = ((x^2 + I) F - 2 F C + 2 x cof F) / (x (x^2 - I) - 2 J)   (Hoger and Carlson's closed form). */

#include "rotation/lanes.h"

/* The largest root of the quartic. Convergence is quadratic: a move of 1e-8 is the last. */
enum { TM_NAME(ITERATIONS) = 24 };
INSIDE void TM_NAME(trace_of_stretch)(const V8 *I, const V8 *II, const V8 *J, V8 *trace) {
    V8 x = 3 * *I;
    TM_NAME(root)(&x);
    M8 under_way = x == x;
    for (int k = 0; k < TM_NAME(ITERATIONS); k++) {
        const V8 y = x * x - *I, slope = 4 * (x * y - 2 * *J), least = 1e-9 * x * *I + 1e-300;
        const M8 steep = slope > least;
        V8 over;
        TM_NAME(choose)(&over, &steep, &slope, &least);
        V8 move = (y * y - 8 * *J * x - 4 * *II) / over;
        move = (V8)((M8)move & (move > 0) & under_way); /* from the right, ever; rounding alone says otherwise */
        x -= move;
        under_way = move > 1e-8 * x;
        if (!TM_NAME(any)(&under_way)) break;
    }
    *trace = x;
}

INSIDE void TM_NAME(polar)(const V8 F[9], V8 R[9], V8 *I, V8 *trace) {
    V8 C[9], FC[9], cof[9];
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) C[3 * i + j] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
    C[3] = C[1], C[6] = C[2], C[7] = C[5];
    TM_NAME(times)(F, C, FC);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = 3 * ((i + 1) % 3), b = 3 * ((i + 2) % 3), c = (j + 1) % 3, d = (j + 2) % 3;
            cof[3 * i + j] = F[a + c] * F[b + d] - F[a + d] * F[b + c];
        }
    *I = C[0] + C[4] + C[8];
    const V8 J = F[0] * cof[0] + F[1] * cof[1] + F[2] * cof[2];
    V8 II = {0};
    for (int i = 0; i < 9; i++) II += cof[i] * cof[i];
    TM_NAME(trace_of_stretch)(I, &II, &J, trace);
    const V8 x = *trace, denominator = x * (x * x - *I) - 2 * J, least = 1e-9 * x * *I + 1e-300;
    const M8 sound = denominator > least;
    V8 over;
    TM_NAME(choose)(&over, &sound, &denominator, &least);
    over = 1 / over;
    for (int i = 0; i < 9; i++) R[i] = ((x * x + *I) * F[i] - 2 * FC[i] + 2 * x * cof[i]) * over;
}

/* T = dw/dE of eq. (1), N = T + 2 g skew(M) with E = sym(M) - 1; returns the energy. */
typedef struct TM_NAME(law) {
    V8 mu, lambda, dlambda, dmu, beta, skew, a[3];
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
INSIDE void TM_NAME(strain)(const V8 M[9], V8 E[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) E[3 * i + j] = 0.5 * (M[3 * i + j] + M[3 * j + i]) - (i == j ? 1.0 : 0.0);
}
INSIDE void TM_NAME(add_skew)(const V8 *g, const V8 M[9], V8 N[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (i != j) N[3 * i + j] += *g * (M[3 * i + j] - M[3 * j + i]);
}

/* X = [e_i] M, the change of M by a turn about axis i. */
INSIDE void TM_NAME(turn_about)(int i, const V8 M[9], V8 X[9]) {
    const int a = (i + 1) % 3, b = (i + 2) % 3;
    for (int j = 0; j < 3; j++) {
        X[3 * i + j] = (V8){0};
        X[3 * a + j] = -M[3 * b + j];
        X[3 * b + j] = M[3 * a + j];
    }
}

/* Second derivative of the energy by a turn about the axes (upper triangle 00 01 02 11 12 22): with `whole` the true
 * one, else the part that is never negative. */
INSIDE void TM_NAME(turn_stiffness)(const TM_NAME(law) * w, const V8 M[9], const V8 B[9], V8 G[6], V8 S[6]) {
    V8 X[3][9], D[9], T[3][9];
    for (int i = 0; i < 3; i++) {
        TM_NAME(turn_about)(i, M, X[i]);
        TM_NAME(strain)(X[i], D);
        for (int k = 0; k < 9; k += 4) D[k] += 1;
        TM_NAME(stress)(w, D, T[i]);
        TM_NAME(add_skew)(&w->skew, X[i], T[i]);
    }
    const V8 trace = B[0] + B[4] + B[8];
    for (int i = 0, at = 0; i < 3; i++)
        for (int j = i; j < 3; j++, at++) {
            G[at] = T[i][0] * X[j][0];
            for (int k = 1; k < 9; k++) G[at] += T[i][k] * X[j][k];
            S[at] = G[at] + 0.5 * (B[3 * i + j] + B[3 * j + i]);
            if (i == j) S[at] -= trace;
        }
}

/* One Newton step of R towards the least energy. Returns the largest square of a turn in w2. */
INSIDE void TM_NAME(relax)(const TM_NAME(law) * w, const V8 F[9], V8 R[9], V8 *w2) {
    V8 M[9], E[9], N[9], B[9], G[6], S[6], turn[3];
    TM_NAME(transposed_times)(R, F, M);
    TM_NAME(strain)(M, E);
    TM_NAME(stress)(w, E, N);
    TM_NAME(add_skew)(&w->skew, M, N);
    TM_NAME(times_transposed)(N, M, B);
    TM_NAME(turn_stiffness)(w, M, B, G, S);
    const V8 minor = S[0] * S[3] - S[1] * S[1];
    V8 det = S[5] * minor - S[0] * S[4] * S[4] - S[3] * S[2] * S[2] + 2 * S[1] * S[2] * S[4];
    const M8 convex = (S[0] > 0) & (minor > 0) & (det > 0);
    const V8 floor = 1e-9 * (G[0] + G[3] + G[5]) + 1e-300;
    for (int k = 0; k < 6; k++) {
        V8 safe = G[k];
        if (k == 0 || k == 3 || k == 5) safe += floor;
        TM_NAME(choose)(&S[k], &convex, &S[k], &safe);
    }
    const V8 g[3] = {B[7] - B[5], B[2] - B[6], B[3] - B[1]};
    const V8 c00 = S[3] * S[5] - S[4] * S[4], c01 = S[2] * S[4] - S[1] * S[5], c02 = S[1] * S[4] - S[2] * S[3];
    const V8 c11 = S[0] * S[5] - S[2] * S[2], c12 = S[1] * S[2] - S[0] * S[4], c22 = S[0] * S[3] - S[1] * S[1];
    det = 1 / (S[0] * c00 + S[1] * c01 + S[2] * c02);
    turn[0] = (c00 * g[0] + c01 * g[1] + c02 * g[2]) * det;
    turn[1] = (c01 * g[0] + c11 * g[1] + c12 * g[2]) * det;
    turn[2] = (c02 * g[0] + c12 * g[1] + c22 * g[2]) * det;
    *w2 = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];
    const V8 shorter = 0.5 / (1 + *w2); /* far steps are cut, near ones keep their order */
    for (int i = 0; i < 3; i++) turn[i] *= shorter;
    /* R := R (1 + 2/(1+q^2) ([q] + [q]^2)), a rotation whatever q. */
    const V8 q2 = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2], f = 2 / (1 + q2);
    V8 Q[9], now[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) Q[3 * i + j] = f * turn[i] * turn[j];
    for (int i = 0; i < 9; i += 4) Q[i] += 1 - f * q2;
    Q[1] -= f * turn[2], Q[3] += f * turn[2], Q[2] += f * turn[1], Q[6] -= f * turn[1], Q[5] -= f * turn[0],
        Q[7] += f * turn[0];
    TM_NAME(times)(R, Q, now);
    for (int i = 0; i < 9; i++) R[i] = now[i];
}

/* Fibred: stress and energy by the rotation that stores the least, of the lanes that have fibres. */
enum { TM_NAME(RELAXATIONS) = 8 };
INSIDE void TM_NAME(fibred)(const TM_NAME(law) * w, const M8 *has, const V8 F[9], V8 R[9], V8 P[9], V8 *energy) {
    M8 under_way = *has;
    for (int k = 0; k < TM_NAME(RELAXATIONS); k++) {
        V8 w2, now[9];
        for (int i = 0; i < 9; i++) now[i] = R[i];
        TM_NAME(relax)(w, F, now, &w2);
        for (int i = 0; i < 9; i++) TM_NAME(choose)(&R[i], &under_way, &now[i], &R[i]);
        under_way &= w2 > 1e-16; /* the next would be the square */
        if (!TM_NAME(any)(&under_way)) break;
    }
    V8 M[9], E[9], N[9], sum = {0}, skew = {0};
    TM_NAME(transposed_times)(R, F, M);
    TM_NAME(strain)(M, E);
    TM_NAME(stress)(w, E, N);
    for (int i = 0; i < 9; i++) sum += E[i] * N[i];
    TM_NAME(add_skew)(&w->skew, M, N);
    for (int i = 0; i < 3; i++) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        const V8 k = M[3 * a + b] - M[3 * b + a];
        skew += 0.5 * k * k;
    }
    *energy = 0.5 * sum + w->skew * skew;
    TM_NAME(times)(R, N, P);
}

/* Isotropic: the rotation of least energy is the polar one as long as the volume is not under more tension than
 * tm_turned_tension; tension grows no further from there on. Stress and energy, less those of the linear law:
 *     2 mu (F - R) + p R - mu (H + H^T) - lambda tr H = mu (H - H^T) + (2 mu - lambda tr H) + (p - 2 mu) R. */
INSIDE void TM_NAME(isotropic)(const V8 *mu, const V8 *lambda, const V8 H[9], const V8 R[9], const V8 *trace,
                               V8 *pressure, V8 add[9]) {
    const V8 twice = 2 * *mu, fifth = 0.2 * *lambda, diagonal = twice - *lambda * (H[0] + H[4] + H[8]);
    const M8 stiff = fifth > twice;
    V8 most;
    TM_NAME(choose)(&most, &stiff, &fifth, &twice);
    *pressure = *lambda * (*trace - 3);
    const M8 over = *pressure > most;
    TM_NAME(choose)(pressure, &over, &most, pressure);
    const V8 turn = *pressure - twice;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            add[3 * i + j] = turn * R[3 * i + j] + (i == j ? diagonal : *mu * (H[3 * i + j] - H[3 * j + i]));
}

INSIDE void TM_NAME(isotropic_energy)(const V8 *mu, const V8 *lambda, const V8 H[9], const V8 *I, const V8 *trace,
                                      const V8 *pressure, V8 *energy) {
    const V8 grown = *trace - 3, uncapped = *lambda * grown, sphere = H[0] + H[4] + H[8];
    V8 stored = 0.5 * uncapped * grown, straight = 0.5 * *lambda * sphere * sphere;
    const M8 over = uncapped > *pressure;
    const V8 beyond = *pressure * (grown - 0.5 * *pressure / *lambda);
    TM_NAME(choose)(&stored, &over, &beyond, &stored);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) straight += 0.5 * *mu * (H[3 * i + j] + H[3 * j + i]) * H[3 * i + j];
    *energy = *mu * (*I - 2 * *trace + 3) + stored - straight;
}

/* Stress and energy of the linear law with fibres, taken off. */
INSIDE void TM_NAME(take_linear)(const TM_NAME(law) * w, const V8 H[9], V8 P[9], V8 *energy) {
    V8 sum = {0}, E[9], T[9];
    TM_NAME(strain)(H, E);
    for (int i = 0; i < 9; i += 4) E[i] += 1;
    TM_NAME(stress)(w, E, T);
    for (int i = 0; i < 9; i++) sum += E[i] * T[i];
    for (int i = 0; i < 9; i++) P[i] -= T[i];
    *energy -= 0.5 * sum;
}

/* The pack's law; false: isotropic. */
INSIDE bool TM_NAME(law_of)(const tm_packs *packs, int32_t p, int at, TM_NAME(law) * w) {
    memcpy(&w->mu, packs->pack[p].mu_J + at, sizeof(V8));
    memcpy(&w->lambda, packs->pack[p].lambda_J + at, sizeof(V8));
    if (!packs->fibred_of || packs->fibred_of[p] < 0) return false;
    const tm_fibre_pack *f = packs->fibred + packs->fibred_of[p];
    memcpy(&w->dlambda, f->dlambda_J + at, sizeof(V8));
    memcpy(&w->dmu, f->dmu_J + at, sizeof(V8));
    memcpy(&w->beta, f->beta_J + at, sizeof(V8));
    memcpy(&w->skew, f->skew_J + at, sizeof(V8));
    for (int i = 0; i < 3; i++) memcpy(&w->a[i], f->fibre[i] + at, sizeof(V8));
    return true;
}

INSIDE void TM_NAME(living)(const tm_packs *packs, int32_t p, int at, M8 *there) {
    if (p < packs->count - 1 &&
        !memcmp(packs->alive + TM_LANES * (int64_t)p + at, (char[8]){1, 1, 1, 1, 1, 1, 1, 1}, TM_WIDTH)) {
        *there = (M8){0} == 0;
        return;
    }
    for (int l = 0; l < TM_WIDTH; l++) {
        const int32_t tet = TM_LANES * p + at + l;
        (*there)[l] = tet < packs->tet_count && packs->alive[tet] ? -1 : 0;
    }
}

/* grad u of the pack's living tetrahedra, 0 of the others. */
INSIDE void TM_NAME(gradient)(const tm_packs *packs, int32_t p, int at, const double *u, V8 H[9]) {
    const tm_pack *pack = packs->pack + p;
    M8 there;
    TM_NAME(living)(packs, p, at, &there);
    for (int i = 0; i < 3; i++) {
        V8 first, d[3], alpha;
        TM_NAME(pick)(u + i, pack->component[0] + at, 1, &first);
        for (int k = 0; k < 3; k++) {
            TM_NAME(pick)(u + i, pack->component[k + 1] + at, 1, &d[k]);
            d[k] -= first;
        }
        for (int j = 0; j < 3; j++) {
            memcpy(&alpha, pack->shape_1_m[j] + at, sizeof alpha);
            H[3 * i + j] = d[0] * alpha;
            for (int k = 1; k < 3; k++) {
                memcpy(&alpha, pack->shape_1_m[3 * k + j] + at, sizeof alpha);
                H[3 * i + j] += d[k] * alpha;
            }
            H[3 * i + j] = (V8)((M8)H[3 * i + j] & there);
        }
    }
}

/* 0 below the threshold, 1 above the band, between them the polynomial whose first two derivatives vanish at both ends;
 * slope: its derivative by |H|^2. False: all are 0. */
INSIDE bool TM_NAME(blend)(const tm_packs *packs, const V8 H[9], V8 *weight, V8 *slope) {
    V8 s = {0};
    for (int i = 0; i < 9; i++) s += H[i] * H[i];
    const V8 one = s * 0 + 1;
    V8 x = (s - packs->begin_1_2) * (1 / packs->width_1_2);
    const M8 above = x > 0, beyond = x > 1;
    x = (V8)((M8)x & above);
    TM_NAME(choose)(&x, &beyond, &one, &x);
    *weight = x * x * x * (10 - x * (15 - 6 * x));
    *slope = 30 * (x * (1 - x)) * (x * (1 - x)) * (1 / packs->width_1_2);
    return TM_NAME(any)(&above);
}

/* What a pack adds: stress and, where asked for or needed, energy; both are whole, the weight is not in them. */
typedef struct TM_NAME(turned) {
    V8 H[9], F[9], polar[9], trace, I; /* the polar rotation, and the trace of its stretch */
    V8 R[9], stress[9], energy, weight, slope;
} TM_NAME(turned);
INSIDE void TM_NAME(straighten)(TM_NAME(turned) * b) {
    for (int i = 0; i < 9; i++) b->F[i] = b->H[i] + (i % 4 ? 0.0 : 1.0);
    TM_NAME(polar)(b->F, b->polar, &b->I, &b->trace);
}
INSIDE void TM_NAME(turn_law)(const TM_NAME(law) * w, bool fibred, bool wants_energy, TM_NAME(turned) * b) {
    V8 pressure;
    for (int i = 0; i < 9; i++) b->R[i] = b->polar[i];
    TM_NAME(isotropic)(&w->mu, &w->lambda, b->H, b->R, &b->trace, &pressure, b->stress);
    const M8 steep = b->slope != 0;
    wants_energy = wants_energy || TM_NAME(any)(&steep);
    b->energy = (V8){0};
    if (wants_energy) TM_NAME(isotropic_energy)(&w->mu, &w->lambda, b->H, &b->I, &b->trace, &pressure, &b->energy);
    if (!fibred) return;
    V8 R[9], P[9], energy; /* some lanes may be isotropic */
    const M8 has = (w->dlambda != 0) | (w->dmu != 0) | (w->beta != 0);
    for (int i = 0; i < 9; i++) R[i] = b->R[i];
    TM_NAME(fibred)(w, &has, b->F, R, P, &energy);
    TM_NAME(take_linear)(w, b->H, P, &energy);
    TM_NAME(choose)(&b->energy, &has, &energy, &b->energy);
    for (int i = 0; i < 9; i++) {
        TM_NAME(choose)(&b->R[i], &has, &R[i], &b->R[i]);
        TM_NAME(choose)(&b->stress[i], &has, &P[i], &b->stress[i]);
    }
}
INSIDE bool TM_NAME(turn)(const tm_packs *packs, int32_t p, int at, const double *u, bool wants_energy,
                          TM_NAME(turned) * b) {
    TM_NAME(law) w;
    TM_NAME(gradient)(packs, p, at, u, b->H);
    if (!TM_NAME(blend)(packs, b->H, &b->weight, &b->slope)) return false;
    const bool fibred = TM_NAME(law_of)(packs, p, at, &w);
    TM_NAME(straighten)(b);
    TM_NAME(turn_law)(&w, fibred, wants_energy, b);
    return true;
}

/* What a stress times the volume pulls a tetrahedron's corners with: 1, 2, 3, and what is left to corner 0. */
INSIDE void TM_NAME(pull)(const tm_packs *packs, int32_t p, int at, const V8 P[9], V8 f[4][3]) {
    const tm_pack *pack = packs->pack + p;
    V8 alpha[9];
    for (int i = 0; i < 9; i++) memcpy(&alpha[i], pack->shape_1_m[i] + at, sizeof(V8));
    for (int i = 0; i < 3; i++) {
        f[0][i] = (V8){0};
        for (int k = 0; k < 3; k++) {
            f[k + 1][i] = P[3 * i] * alpha[3 * k] + P[3 * i + 1] * alpha[3 * k + 1] + P[3 * i + 2] * alpha[3 * k + 2];
            f[0][i] -= f[k + 1][i];
        }
    }
}

/* The same onto force_N, the marked lanes ascending. */
INSIDE void TM_NAME(scatter)(const tm_packs *packs, int32_t p, int at, const M8 *who, const V8 P[9], double *force_N) {
    const tm_pack *pack = packs->pack + p;
    V8 pulls[4][3];
    double f[4][3][TM_WIDTH] __attribute__((aligned(64)));
    TM_NAME(pull)(packs, p, at, P, pulls);
    memcpy(f, pulls, sizeof f);
    for (int l = 0; l < TM_WIDTH; l++) {
        if (!(*who)[l]) continue;
        for (int k = 0; k < 4; k++)
            for (int i = 0; i < 3; i++) force_N[pack->component[k][at + l] + i] -= f[k][i][l];
    }
}

INSIDE void TM_NAME(stress_of)(const TM_NAME(turned) * b, V8 P[9]) {
    const V8 steer = 2 * b->slope * b->energy;
    for (int i = 0; i < 9; i++) P[i] = b->weight * b->stress[i] + steer * b->H[i];
}

TM_TARGET static int32_t TM_NAME(force)(const tm_packs *packs, const int32_t *list, int32_t count, const double *u_m,
                                        double *force_N) {
    int32_t active = 0;
    for (int32_t n = 0; n < count; n++) {
        bool any = false;
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            TM_NAME(turned) b;
            V8 P[9];
            if (!TM_NAME(turn)(packs, list[n], at, u_m, false, &b)) continue;
            any = true;
            const M8 who = b.weight > 0;
            TM_NAME(stress_of)(&b, P);
            TM_NAME(scatter)(packs, list[n], at, &who, P, force_N);
        }
        active += any;
    }
    return active;
}
#include "rotation/pulls_kernel.h"
#include "rotation/swollen_kernel.h"
#include "rotation/viscous_kernel.h"
#undef V8
#undef M8
#undef INSIDE
