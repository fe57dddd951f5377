/* Bounds of the tangents of nonlinear laws (law_bound.c), row by row of tm_laws: random constants, states from random
 * starts uphill, flat, inside out and beyond the limit too. No state is stiffer than the bound, and the stiffest found
 * is not far below: a bound far away would make steps shorter than need be. */
#include <math.h>
#include <string.h>

#include "../fixture.h"
#include "../long.h"
#include "law_rows.h"
#include "material/hyperelastic.h"
#include "material/law.h"

/* A tetrahedron with the unit tensor as shape gradients: u of its corners 1 to 3 are the columns of F - 1. */
typedef struct body {
    tm_material material;
    tm_mesh *mesh;
    tm_pool pool;
    tm_hyperelastic hyper;
    double fibre[3], averaged_Pa; /* bulk modulus of averaged dilatation, or 0 */
    bool fibred;
    fix_random random;
} body;

static double between(fix_random *r, double from, double to) { return from + (to - from) * 0.5 * (1 + fix_signed(r)); }

/* Constants of any size that the law accepts; the first are those of other tests. */
static tm_material random_material(const tm_law *law, bool fibred, fix_random *r) {
    tm_material m;
    tm_error error;
    for (;;) {
        const double ratio = between(r, 1, 4), share = between(r, 0, 1);
        double constant[TM_LAW_CONSTANTS] = {0};
        const tm_law_constant *c;
        for (int i = 0; (c = tm_law_constant_at(law->kind, i)); i++)
            constant[i] = c->max <= 1 ? between(r, c->min, c->max) : c->example * between(r, 0.2, 3);
        fix_ok(tm_material_young(5e3, between(r, 0.2, 0.49), &m, &error), &error);
        if (fibred) m.dmu_Pa = (ratio - 1) * m.mu_Pa, m.beta_Pa = share * 4 * m.mu_Pa;
        if (tm_material_set_law(&m, law->kind, constant, between(r, 1.3, 2), &error) == TM_OK) return m;
    }
}

static void make(body *b, const tm_law *law, bool fibred, bool averaged, uint64_t seed) {
    static const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const uint8_t alive = 1;
    static const int32_t own = 0;
    tm_error error;
    *b = (body){.random = {seed}, .fibred = fibred || tm_law_needs_fibre(law->kind), .fibre = {1, 0, 0}};
    b->material = random_material(law, fibred, &b->random);
    b->averaged_Pa = averaged ? tm_material_bulk_Pa(&b->material) : 0;
    fix_ok(fix_one_tet(corner, &b->mesh, &error), &error);
    tm_material rest = b->material; /* of the tetrahedron: the law without the averaged modulus */
    rest.lambda_Pa -= b->averaged_Pa;
    const tm_material_field field = {.mesh = b->mesh,
                                     .alive = &alive,
                                     .material = &rest,
                                     .region_material = &own,
                                     .material_count = 1,
                                     .fibre = b->fibre};
    assert_true(tm_hyperelastic_take(&b->hyper, &b->pool, &field));
    double constant[TM_LAW_CONSTANTS]; /* of all moduli */
    tm_law_constants(&b->material, b->mesh->volume_m3[0], constant);
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) ((tm_law_pack *)b->hyper.law)->constant[i][0] = constant[i];
}

static void destroy(body *b) {
    tm_pool_release(&b->pool);
    tm_mesh_destroy(b->mesh);
}

/* The largest eigenvalue, by powers of A + shift. */
static double largest_eigenvalue(const double A[81], fix_random *r) {
    double x[9], y[9], shift = 0, length = 0;
    for (int i = 0; i < 9; i++) {
        double row = 0;
        for (int j = 0; j < 9; j++) row += fabs(A[9 * i + j]);
        shift = fmax(shift, 0.5 * row), x[i] = fix_signed(r);
    }
    for (int turn = 0; turn < 100; turn++) {
        length = 0;
        for (int i = 0; i < 9; i++) {
            y[i] = shift * x[i];
            for (int j = 0; j < 9; j++) y[i] += A[9 * i + j] * x[j];
            length += y[i] * y[i];
        }
        for (int i = 0; i < 9; i++) x[i] = y[i] / sqrt(length);
    }
    return sqrt(length) - shift; /* from below */
}

static void cofactors(const double F[9], double B[9]) {
    for (int i = 0; i < 9; i++) {
        const int a = 3 * ((i / 3 + 1) % 3), b = 3 * ((i / 3 + 2) % 3), c = (i % 3 + 1) % 3, d = (i % 3 + 2) % 3;
        B[i] = F[a + c] * F[b + d] - F[a + d] * F[b + c];
    }
}

/* Stiffness at F, Pa. With averaged dilatation the worst of its pressures, and all of its modulus, within the limit of
 * stretch, where the dilatation is that of F. */
static double stiffness(body *b, const double F[9], double least, double most) {
    double u[12] = {0}, A[81], B[9], K[81], found = 0;
    for (int k = 1; k < 4; k++)
        for (int i = 0; i < 3; i++) u[3 * k + i] = F[3 * i + k - 1] - (i == k - 1);
    tm_hyperelastic_hessian(&b->hyper, 0, u, A);
    const double volume = b->mesh->volume_m3[0];
    for (int i = 0; i < 81; i++) A[i] /= volume;
    if (b->averaged_Pa == 0) return largest_eigenvalue(A, &b->random);
    tm_hyperelastic_dilatation_hessian(&b->hyper, 0, u, K);
    cofactors(F, B);
    double square = 0, limit = b->material.stretch_max;
    for (int i = 0; i < 9; i++) square += F[i] * F[i];
    for (int end = 0; end < 2; end++) {
        double all[81];
        for (int i = 0; i < 81; i++) {
            all[i] = A[i] + b->averaged_Pa * ((end ? most : least) - 1) * K[i];
            if (square <= limit * limit + 2 / limit) all[i] += b->averaged_Pa * B[i / 9] * B[i % 9];
        }
        found = fmax(found, largest_eigenvalue(all, &b->random));
    }
    return found;
}

/* Returns whether F is allowed: any, or det F > 0 and |E| <= strain. */
static bool is_within(const double F[9], double strain) {
    double B[9], J = 0, E2 = 0;
    if (strain == 0) return true;
    cofactors(F, B);
    for (int i = 0; i < 3; i++) J += F[i] * B[i];
    for (int i = 0; i < 9; i++) {
        const double C = F[i / 3] * F[i % 3] + F[3 + i / 3] * F[3 + i % 3] + F[6 + i / 3] * F[6 + i % 3];
        E2 += 0.25 * pow(C - (i % 4 ? 0 : 1), 2);
    }
    return J > 0 && E2 <= strain * strain;
}

/* A random state: any F to twice the limit, or principal stretches near it in the axes of the fibre. */
static void start(body *b, double strain, double F[9]) {
    const double s = b->material.stretch_max, limit = sqrt(s * s + 2 / s);
    const bool principal = fix_signed(&b->random) > -0.5;
    do {
        double length = 0, size = strain > 0 ? 1 : (principal ? 0.25 + 0.06 * fix_signed(&b->random) : 0.5);
        for (int i = 0; i < 9; i++) {
            F[i] = principal && i % 4 ? 0 : fix_signed(&b->random);
            if (principal && i % 4 == 0 && fix_signed(&b->random) > -0.5) F[i] = 0.6 + 0.4 * F[i];
            length += F[i] * F[i];
        }
        for (int i = 0; i < 9; i++)
            F[i] = strain > 0 ? strain * F[i] + (i % 4 == 0) : 4 * size * limit * F[i] / sqrt(length);
    } while (!is_within(F, strain));
}

static double sought(body *b, double strain) {
    const int starts = test_is_long() ? 200 : 30, turns = test_is_long() ? 600 : 150;
    const double part = 2 * strain / sqrt(3);
    const double least = strain > 0 ? fmax(pow(1 - part, 1.5), 0.5) : 0.5,
                 most = strain > 0 ? fmin(pow(1 + part, 1.5), 1.5) : 1.5;
    double best = 0;
    for (int n = 0; n < starts; n++) {
        double F[9], near[9], at = 0, step = strain > 0 ? 0.3 * strain : 0.3;
        start(b, strain, F);
        for (int k = 0; k < turns; k++, step *= 0.975) {
            for (int i = 0; i < 9; i++) near[i] = F[i] + (k ? step * fix_signed(&b->random) : 0);
            if (!is_within(near, strain)) continue;
            const double there = stiffness(b, near, least, most);
            if (there > at) at = there, memcpy(F, near, sizeof F);
        }
        best = fmax(best, at);
    }
    return best;
}

static void no_state_exceeds_the_bound(void **state) {
    (void)state;
    const int materials = test_is_long() ? 12 : 2;
    for (const tm_law *const *law = tm_laws; *law; law++)
        for (int fibred = 0;
             law_is_tested((*law)->kind) && fibred <= tm_law_has_fibres((*law)->kind) && (*law)->kind != TM_LAW_LINEAR;
             fibred++)
            for (int averaged = 0; averaged < 2; averaged++) {
                double worst = 0, loosest = HUGE_VAL, small = 0;
                for (int n = 0; n < materials; n++) {
                    body b;
                    make(&b, *law, fibred, averaged, 17 + 100 * (uint64_t)n);
                    const double bound = tm_law_stiffest_Pa(&b.material, averaged), found = sought(&b, 0);
                    const double within = tm_law_stiffest_within_Pa(&b.material, averaged, 0.1);
                    worst = fmax(worst, found / bound), loosest = fmin(loosest, found / bound);
                    small = fmax(small, sought(&b, 0.1) / within);
                    assert_true(within <= bound && within > tm_material_stiffest_Pa(&b.material) * (1 - 1e-9));
                    destroy(&b);
                }
                print_message("%s%s%s: reached %.3f to %.3f of the bound, %.3f of that to a strain of 0.1\n",
                              (*law)->name, fibred ? ", fibred" : "", averaged ? ", averaged" : "", loosest, worst,
                              small);
                assert_true(worst <= 1 && small <= 1);
                assert_true(small > 0.6 && worst > 0.4);
            }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(no_state_exceeds_the_bound)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
