/* The bound of a viscous step under nonlinear laws (tm_law_history_limits): over random paths that compress fast, hold
 * and relax, no tangent at the histories reached is stiffer than the law's bound and what histories may add. */
#include <math.h>
#include <string.h>

#include "law_rows.h"
#include "material/hyperelastic.h"
#include "material/law.h"
#include "material/prony.h"

/* A tetrahedron with the unit tensor as shape gradients: u of its corners 1 to 3 are the columns of F - 1. */
typedef struct body {
    tm_material material;
    tm_mesh *mesh;
    tm_pool pool;
    tm_hyperelastic hyper;
    tm_viscous terms;
    tm_viscosity_def def;
    double bulk_J[TM_LANES], stress_J[TM_LANES], pressure_J[2][TM_LANES], corner_N[12 * TM_LANES];
    double history[2][7 * TM_LANES];
    double bound_Pa, law_Pa;
    fix_random random;
} body;

static double between(fix_random *r, double from, double to) { return from + (to - from) * 0.5 * (1 + fix_signed(r)); }

static tm_material material_of(tm_law_kind law, bool fibred, double poisson) {
    tm_material m;
    tm_error error;
    fix_ok(tm_material_young(5e3, poisson, &m, &error), &error);
    if (fibred) m.dmu_Pa = 2 * m.mu_Pa, m.beta_Pa = 3 * m.mu_Pa;
    law_set(&m, law);
    return m;
}

/* Terms that relax nearly all: shares of 0.6 and 0.35. */
static void make(body *b, tm_law_kind law, bool fibred, double poisson, bool limited) {
    static const double corner[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, fibre[3] = {1, 0, 0};
    static const uint8_t alive = 1;
    static const int32_t own = 0;
    tm_error error;
    *b = (body){.random = {5}, .material = material_of(law, fibred, poisson)};
    fix_ok(fix_one_tet(corner, &b->mesh, &error), &error);
    const tm_material_field field = {.mesh = b->mesh,
                                     .alive = &alive,
                                     .material = &b->material,
                                     .region_material = &own,
                                     .material_count = 1,
                                     .fibre = fibre};
    assert_true(tm_hyperelastic_take(&b->hyper, &b->pool, &field));
    b->def = tm_viscosity_def_default();
    b->def.count = 2;
    b->def.term[0] = (tm_viscosity_term){.time_s = 0.01, .shear = 0.6, .bulk = 0.6};
    b->def.term[1] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.35, .bulk = 0.35};
    b->law_Pa = tm_law_stiffest_Pa(&b->material, false);
    const tm_history_limits limits = tm_law_history_limits(&b->material, false, 0.15 * b->law_Pa, false, 0.95, 0.95);
    const double volume = b->mesh->volume_m3[0];
    assert_true(limits.more_Pa <= 0.15 * b->law_Pa * (1 + 1e-12));
    b->bound_Pa = b->law_Pa + limits.more_Pa;
    for (int l = 0; l < TM_LANES; l++) {
        b->bulk_J[l] = l ? 0 : volume * tm_material_bulk_Pa(&b->material);
        b->stress_J[l] = limited ? volume * limits.stress_Pa : HUGE_VAL;
        for (int side = 0; side < 2; side++)
            b->pressure_J[side][l] = limited ? volume * limits.pressure_Pa[side] : side ? HUGE_VAL : -HUGE_VAL;
    }
    b->hyper.bulk_J = b->bulk_J, b->hyper.history_stress_J = b->stress_J;
    for (int side = 0; side < 2; side++) b->hyper.history_pressure_J[side] = b->pressure_J[side];
    b->terms = (tm_viscous){.terms = 2, .corner_N = b->corner_N};
    for (int t = 0; t < 2; t++) {
        b->terms.shear[t] = b->def.term[t].shear, b->terms.volume[t] = b->def.term[t].bulk;
        b->terms.history[t] = b->history[t], b->terms.swelling[t] = b->history[t] + 6 * TM_LANES;
    }
}

static void destroy(body *b) {
    tm_pool_release(&b->pool);
    tm_mesh_destroy(b->mesh);
}

/* Computes P, J, at F; with a step dt_s also advances the histories. */
static void stress(body *b, const double F[9], double dt_s, double P[9]) {
    double u[12] = {0};
    tm_viscous v = b->terms;
    for (int k = 1; k < 4; k++)
        for (int i = 0; i < 3; i++) u[3 * k + i] = F[3 * i + k - 1] - (i == k - 1);
    v.history_frozen = dt_s == 0;
    for (int t = 0; t < 2 && dt_s > 0; t++) {
        const tm_fading f = tm_fading_of(dt_s, b->def.term[t].time_s);
        v.history_kept[t] = f.kept_share, v.old[t] = f.old, v.now[t] = f.now;
    }
    tm_hyper_strain_choose(true)(&b->hyper, &v, NULL, 0, 1, u);
    for (int k = 1; k < 4; k++)
        for (int i = 0; i < 3; i++) P[3 * i + k - 1] = b->corner_N[TM_LANES * (3 * k + i)];
}

/* Returns the largest eigenvalue of the tangent at the histories, Pa, from below: powers of A + shift. */
static double stiffness(body *b, const double F[9]) {
    double A[81], x[9], y[9], shift = 0, length = 0;
    for (int k = 0; k < 9; k++) {
        double at[9], more[9], less[9], h = 1e-5;
        memcpy(at, F, sizeof at);
        at[k] = F[k] + h, stress(b, at, 0, more);
        at[k] = F[k] - h, stress(b, at, 0, less);
        for (int i = 0; i < 9; i++) A[9 * i + k] = (more[i] - less[i]) / (2 * h * b->mesh->volume_m3[0]);
    }
    for (int i = 0; i < 9; i++) {
        double row = 0;
        for (int j = 0; j < 9; j++) row += 0.5 * fabs(A[9 * i + j] + A[9 * j + i]);
        shift = fmax(shift, 0.5 * row), x[i] = fix_signed(&b->random);
    }
    for (int turn = 0; turn < 60; turn++) {
        length = 0;
        for (int i = 0; i < 9; i++) {
            y[i] = shift * x[i];
            for (int j = 0; j < 9; j++) y[i] += 0.5 * (A[9 * i + j] + A[9 * j + i]) * x[j];
            length += y[i] * y[i];
        }
        for (int i = 0; i < 9; i++) x[i] = y[i] / sqrt(length);
    }
    return sqrt(length) - shift;
}

/* Moves on a straight line to a random state, mostly flat ones, in one to twenty steps, and holds it. */
static void wander(body *b, double F[9]) {
    double to[9], P[9];
    const int steps = 1 + (int)between(&b->random, 0, 20), holds = (int)between(&b->random, 0, 60);
    const double dt_s = pow(10, between(&b->random, -4, -2));
    for (int i = 0; i < 9; i++) to[i] = 0.3 * fix_signed(&b->random) + (i % 4 == 0);
    const int flat = (int)between(&b->random, 0, 2.999);
    for (int i = 0; i < 3; i++) to[3 * i + flat] *= between(&b->random, 0.15, 1);
    for (int s = 1; s <= steps + holds; s++) {
        double at[9];
        for (int i = 0; i < 9; i++) at[i] = s < steps ? F[i] + (to[i] - F[i]) * s / steps : to[i];
        stress(b, at, dt_s, P);
    }
    memcpy(F, to, sizeof to);
}

/* Returns the stiffest state found at the histories of random paths, from each state uphill, over the law's bound. */
static double sought(body *b, int paths) {
    double worst = 0, F[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int n = 0; n < paths; n++) {
        double from[9], near[9], best = 0, size = 0.5;
        wander(b, F);
        memcpy(from, F, sizeof from);
        for (int k = 0; k < 60; k++, size *= 0.95) {
            for (int i = 0; i < 9; i++) near[i] = from[i] + (k ? size * fix_signed(&b->random) : 0);
            const double there = stiffness(b, near);
            if (there > best) best = there, memcpy(from, near, sizeof near);
        }
        worst = fmax(worst, best);
    }
    return worst / b->law_Pa;
}

static void no_path_exceeds_the_bound(void **state) {
    (void)state;
    double limited = 0, unlimited = 0;
    for (const tm_law *const *law = tm_laws; *law; law++)
        for (int k = 0; k < 4 && (*law)->kind != TM_LAW_LINEAR; k++) {
            const bool fibred = k % 2;
            const double poisson = k < 2 ? 0.45 : 0.2;
            if (fibred && !tm_law_has_fibres((*law)->kind)) continue;
            body b;
            make(&b, (*law)->kind, fibred, poisson, true);
            const double found = sought(&b, 40), most = b.bound_Pa / b.law_Pa;
            destroy(&b);
            make(&b, (*law)->kind, fibred, poisson, false);
            const double loose = sought(&b, 40);
            destroy(&b);
            print_message("%s%s, nu %g: %.3f of the law's bound, at most %.3f; %.3f without limits of histories\n",
                          tm_law_name((*law)->kind), fibred ? ", fibred" : "", poisson, found, most, loose);
            assert_true(found <= most);
            limited = fmax(limited, found), unlimited = fmax(unlimited, loose);
        }
    /* Without the limits a path exceeds the law's bound. */
    assert_true(unlimited > 1.05 && unlimited > limited + 0.05);
}

/* Shares of 0.5: usual states relax in full. */
static void usual_states_are_within_the_limits(void **state) {
    (void)state;
    const tm_material m = material_of(TM_LAW_NEO_HOOKE, false, 0.45);
    const tm_history_limits l = tm_law_history_limits(&m, false, 0.15 * tm_law_stiffest_Pa(&m, false), false, 0.5, 0.5);
    const double stress = l.stress_Pa / m.mu_Pa, kappa_Pa = tm_material_bulk_Pa(&m);
    const double least = l.pressure_Pa[0] / kappa_Pa, most = l.pressure_Pa[1] / kappa_Pa;
    print_message("neo-Hooke, nu 0.45: |S| up to %.1f mu, J - 1 from %.2f to %.2f\n", stress, least, most);
    assert_true(stress > 3 && least < -0.4 && most > 0.2);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(usual_states_are_within_the_limits),
                                       cmocka_unit_test(no_path_exceeds_the_bound)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
