/* Nonlinear laws: forms of their kernel, energies, and tangents by the complex step.
 *
 * Over 400 lines: the search of bounds differentiates the kernel that is included here. */
#include "material/hyperelastic.h"

#include <complex.h>
#undef I
#include <math.h>
#include <stdatomic.h>
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

#define TM_NAME(x) tm_complex_##x
#define TM_TARGET
#include "material/complex_lane.h"

#include "material/hyperelastic_kernel.h"
#undef V8
#undef M8
#undef INSIDE
#undef TM_NAME
#undef TM_TARGET

tm_hyper_force tm_hyper_force_form(int form) {
#ifdef TM_HAS_AVX2
    if (form == 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return tm_avx512_hyper_force;
    if (form == 1 && __builtin_cpu_supports("avx2")) return tm_avx2_hyper_force;
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
    (void)form;
    return tm_plain_hyper_strain;
}

tm_hyper_green tm_hyper_green_choose(bool plain) {
    const tm_hyper_force form = tm_hyper_force_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_hyper_force) return tm_avx512_hyper_green;
    if (form == tm_avx2_hyper_force) return tm_avx2_hyper_green;
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

void tm_law_constants(const tm_material *m, double volume, double c[TM_LAW_CONSTANTS]) {
    memcpy(c, m->law_constant, TM_LAW_CONSTANTS * sizeof *c);
    if (m->law == TM_LAW_FUNG) c[0] *= volume, c[1] = tm_law_exponent_limit(m);
    if (m->law == TM_LAW_HOLZAPFEL) c[0] *= volume, c[3] = tm_law_fibre_limit(m);
}

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
    case TM_LAW_NEO_HOOKE: return tm_plain_neo_hooke_energy(w, s, lane);
    case TM_LAW_ST_VENANT_KIRCHHOFF: return tm_plain_green_energy(w, H, s, lane, false);
    case TM_LAW_MOONEY_RIVLIN: return tm_plain_mooney_rivlin_energy(w, s, lane);
    case TM_LAW_FUNG: return tm_plain_green_energy(w, H, s, lane, true);
    case TM_LAW_HOLZAPFEL: return tm_plain_holzapfel_energy(w, H, s, lane);
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

/* --- the bound --- */

static double largest_eigenvalue(double A[81]) {
    for (int sweep = 0; sweep < 12; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < 81; i++) *(i % 10 ? &off : &diagonal) += A[i] * A[i];
        if (off <= 1e-12 * diagonal) break;
        for (int p = 0; p < 8; p++)
            for (int q = p + 1; q < 9; q++) tm_jacobi(A, 9, p, q, &(double){0}, &(double){0});
    }
    double most = A[0];
    for (int i = 10; i < 81; i += 10) most = fmax(most, A[i]);
    return most;
}

/* A point of the search: |F| relative to that at the limit, and two angles of the principal stretches, of which the
 * third may be negative. Within a range of strain: the norm of Green's strain, and two angles of its principal values.
 * With fibres, two angles of theirs among the principal axes. */
enum { PLACE = 5, TOPS = 8 };
typedef struct search {
    int64_t law;
    tm_complex_hyper w;
    int angles;     /* of the stretches alone, or of the fibre too */
    double bulk_Pa; /* averaged dilatation; 0: none */
    bool strains;
    double least, most; /* of x[0] */
    double top[TOPS], at[TOPS][PLACE];
} search;

/* The energy of an average is at most the average of the energies: a domain's kappa/2 of the squared dilatation adds at
 * most kappa B B^T to each tetrahedron, B the dilatation's derivative. Its pressure, in a range known, adds the second
 * derivative; the eigenvalue is convex in the pressure, so that an end of the range is worst. */
static double averaged_stiffness(const search *s, const double H[9], const double A[81]) {
    double _Complex at[9], slope[9], grown;
    double bend[81], all[81], most = 0;
    for (int i = 0; i < 9; i++) at[i] = H[i];
    tm_complex_dilatation(s->law, &s->w, at, &grown, slope);
    differentiate(s->law, &s->w, H, true, bend);
    for (int end = 0; end < 2; end++) {
        const double pressure = s->bulk_Pa * ((end ? TM_VOLUME_MOST : TM_VOLUME_LEAST) - 1);
        for (int i = 0; i < 81; i++)
            all[i] = A[i] + pressure * bend[i] + s->bulk_Pa * creal(slope[i / 9]) * creal(slope[i % 9]);
        most = fmax(most, largest_eigenvalue(all));
    }
    return most;
}

static double stiffness_at(search *s, const double x[PLACE]) {
    const double t = s->strains ? x[0] : x[0] * sqrt(creal(s->w.I3_max) + 3);
    const double e[3] = {t * sin(x[1]) * cos(x[2]), t * sin(x[1]) * sin(x[2]), t * cos(x[1])};
    double H[9] = {0}, A[81];
    for (int i = 0; i < 3; i++) H[4 * i] = (s->strains ? sqrt(fmax(1 + 2 * e[i], 0)) : e[i]) - 1;
    s->w.fibre[0] = sin(x[3]) * cos(x[4]), s->w.fibre[1] = sin(x[3]) * sin(x[4]), s->w.fibre[2] = cos(x[3]);
    differentiate(s->law, &s->w, H, false, A);
    if (s->bulk_Pa > 0) return averaged_stiffness(s, H, A);
    return largest_eigenvalue(A);
}

/* Climbs from x by steps that halve. */
static double climb(search *s, double x[PLACE], double best) {
    for (double step = 0.1; step > 1e-4; step *= 0.5)
        for (bool moved = true; moved;) {
            moved = false;
            for (int k = 0; k < 2 * (1 + s->angles); k++) {
                double y[PLACE];
                memcpy(y, x, sizeof y);
                y[k / 2] += k % 2 ? step : -step;
                if (!(y[0] > s->least && y[0] < s->most)) continue;
                const double there = stiffness_at(s, y);
                if (there > best * (1 + 1e-9)) best = there, memcpy(x, y, sizeof y), moved = true;
            }
        }
    return best;
}

static bool has_fibres(const tm_material *m) { return m->law == TM_LAW_HOLZAPFEL || !tm_material_is_isotropic(m); }

static search search_of(const tm_material *m, bool averaged) {
    const double stretch = m->stretch_max;
    search s = {
        .law = m->law, .angles = has_fibres(m) ? 4 : 2, .bulk_Pa = averaged ? tm_material_bulk_Pa(m) : 0, .most = 4};
    double c[TM_LAW_CONSTANTS];
    tm_law_constants(m, 1, c);
    s.w = (tm_complex_hyper){.mu = m->mu_Pa,
                             .lambda = m->lambda_Pa - s.bulk_Pa,
                             .dlambda = m->dlambda_Pa,
                             .dmu = m->dmu_Pa,
                             .beta = m->beta_Pa,
                             .I3_max = stretch * stretch + 2 / stretch - 3};
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) s.w.c[i] = c[i];
    return s;
}

/* Keeps x if it is among the stiffest. */
static void try_place(search *s, const double x[PLACE]) {
    const double a = stiffness_at(s, x);
    int least = 0;
    for (int q = 1; q < TOPS; q++)
        if (s->top[q] < s->top[least]) least = q;
    if (a > s->top[least]) s->top[least] = a, memcpy(s->at[least], x, PLACE * sizeof *x);
}

static double climb_all(search *s) {
    double most = 0;
    for (int q = 0; q < TOPS; q++) most = fmax(most, climb(s, s->at[q], s->top[q]));
    return TM_BOUND_MARGIN * most;
}

static double search_stiffest_Pa(const tm_material *m, bool averaged) {
    const double pi = acos(-1);
    const bool fibred = has_fibres(m);
    const int lengths = fibred ? 14 : 24, turns = fibred ? 8 : 16, fibres = fibred ? 4 : 0;
    search s = search_of(m, averaged);
    const int64_t places = (int64_t)lengths * 2 * turns * (turns + 1) * (fibres + 1) * (fibres + 1);
    for (int64_t n = 0; n < places; n++) {
        int64_t left = n;
        const int i = (int)(left % lengths), j = (int)((left /= lengths) % (2 * turns));
        const int k = (int)((left /= 2 * turns) % (turns + 1)), f = (int)((left /= turns + 1) % (fibres + 1));
        const int g = (int)(left / (fibres + 1));
        try_place(&s, (double[PLACE]){2.0 * (i + 1) / lengths, pi * (j + 0.5) / (2 * turns), pi / 2 * k / turns,
                                      fibres ? pi / 2 * f / fibres : 0, fibres ? pi / 2 * g / fibres : 0});
    }
    return climb_all(&s);
}

double tm_law_stiffest_between_Pa(const tm_material *m, double from, double to) {
    if (m->law == TM_LAW_LINEAR) return tm_material_stiffest_Pa(m);
    enum { TURNS = 8, FIBRES = 4 };
    const double pi = acos(-1);
    const int fibres = has_fibres(m) ? FIBRES : 0;
    search s = search_of(m, false);
    s.strains = true, s.least = from, s.most = to * (1 + 1e-12);
    for (int j = 0; j <= TURNS; j++)
        for (int k = 0; k < 2 * TURNS; k++)
            for (int f = 0; f < (fibres + 1) * (fibres + 1); f++)
                try_place(&s, (double[PLACE]){to, pi * j / TURNS, pi * k / TURNS, pi / 2 * (f % (FIBRES + 1)) / FIBRES,
                                              pi / 2 * (f / (FIBRES + 1)) / FIBRES});
    return climb_all(&s);
}

enum { REMEMBERED = 16 };
/* The last bounds that were sought. One thread at a time reads or writes them; another searches instead of waiting.
 * Not in thread-local storage: that would need more than the C library. */
static struct {
    atomic_flag taken;
    struct {
        tm_material material; /* without padding: material.h */
        bool averaged;
        double stiffest_Pa;
    } known[REMEMBERED];
    int next;
} remembered = {.taken = ATOMIC_FLAG_INIT};

/* Returns 0 if the bound is unknown. */
static double recall_Pa(const tm_material *m, bool averaged) {
    double found = 0;
    if (atomic_flag_test_and_set_explicit(&remembered.taken, memory_order_acquire)) return 0;
    for (int i = 0; i < REMEMBERED; i++)
        if (remembered.known[i].stiffest_Pa > 0 && remembered.known[i].averaged == averaged &&
            !memcmp(&remembered.known[i].material, m, sizeof *m))
            found = remembered.known[i].stiffest_Pa;
    atomic_flag_clear_explicit(&remembered.taken, memory_order_release);
    return found;
}

static void remember(const tm_material *m, bool averaged, double stiffest_Pa) {
    if (atomic_flag_test_and_set_explicit(&remembered.taken, memory_order_acquire)) return;
    remembered.known[remembered.next].material = *m;
    remembered.known[remembered.next].averaged = averaged;
    remembered.known[remembered.next].stiffest_Pa = stiffest_Pa;
    remembered.next = (remembered.next + 1) % REMEMBERED;
    atomic_flag_clear_explicit(&remembered.taken, memory_order_release);
}

/* A search takes 50 ms or more, and programs that fit or compare build the same materials again and again: the last
 * bounds are remembered. */
double tm_law_stiffest_Pa(const tm_material *m, bool averaged) {
    if (m->law == TM_LAW_LINEAR) return tm_material_stiffest_Pa(m);
    const double known = recall_Pa(m, averaged);
    if (known > 0) return known;
    const double found = search_stiffest_Pa(m, averaged);
    remember(m, averaged, found);
    return found;
}
