/* Nonlinear laws with viscosity, in time: the critical step with Maxwell branches against the amplification matrix,
 * just below and above it; the period and the decrement of a beam against those of linear tissue. */
#include "law_body.h"
#include "tensormass/viscosity.h"
#include "world/world_internal.h"

#include <complex.h>
#undef I

static tm_viscosity_def series(double share, double time_s) {
    tm_viscosity_def def = tm_viscosity_def_default();
    def.count = 2;
    def.term[0] = (tm_viscosity_term){.time_s = time_s, .shear = share, .bulk = share};
    def.term[1] = (tm_viscosity_term){.time_s = 7 * time_s, .shear = 0.5 * share, .bulk = 0.5 * share};
    return def;
}

static body box(const int cells[3], const double size[3], tm_law_kind law, const tm_viscosity_def *terms) {
    fix_random random = {11};
    tm_error error;
    const tm_material m = material_of(law, 0.3, false);
    tm_tissue_def def = tm_tissue_def_default();
    def.material_count = 1, def.material = &m;
    body b = make(fix_block(cells, size, 0, &random), def, 1, false);
    if (terms) fix_ok(tm_stage_viscosity(b.world, terms, &error), &error);
    return b;
}

/* --- the critical step --- */

/* Of one mode, 1/s: u+ = 2 u - u- - dt^2 w^2 (u - sum g_i h_i), h_i the exact history of a u straight within each step.
 * At z = -1 a history is H u, H = 1 - tanh(x/2)/(x/2), x = dt/time, and 4/dt^2 = w^2 (1 - sum g_i H_i). */
static double critical_s(const tm_viscosity_def *def, double omega_1_s) {
    double dt_s = 2 / omega_1_s;
    for (int k = 0; k < 200; k++) {
        double left = 1;
        for (int t = 0; t < def->count; t++) {
            const double x = dt_s / def->term[t].time_s;
            left -= def->term[t].shear * (1 - tanh(x / 2) / (x / 2));
        }
        dt_s = 2 / (omega_1_s * sqrt(left));
    }
    return dt_s;
}

/* Growth of that mode per step, by powers of the amplification matrix. */
static double growth(const tm_viscosity_def *def, double omega_1_s, double dt_s) {
    double u = 1, last = 1, h[TM_VISCOSITY_TERMS] = {0}, size = 0;
    enum { STEPS = 4000 };
    for (int step = 0; step < STEPS; step++) {
        double force = u;
        for (int t = 0; t < def->count; t++) {
            const double x = dt_s / def->term[t].time_s, kept = exp(-x), now = 1 - (1 - kept) / x, old = 1 - kept - now;
            h[t] = kept * h[t] + old * last + now * u;
            force -= def->term[t].shear * h[t];
        }
        const double next = 2 * u - last - dt_s * dt_s * omega_1_s * omega_1_s * force;
        last = u, u = next, size = fabs(u) + fabs(last);
    }
    return pow(size, 1.0 / STEPS);
}

/* Largest displacement after many steps at a share of the critical step, over that at the start. */
static double left_after(tm_law_kind law, const tm_viscosity_def *def, double share) {
    body b = box((int[]){2, 2, 2}, (double[]){SIDE_M, SIDE_M, SIDE_M}, law, def);
    fix_random random = {5};
    tm_error error;
    double sharp_s;
    fix_ok(tm_critical_step_estimate(b.tissue, NULL, 1e-9, 100000, &sharp_s, &error), &error);
    const double dt_s = critical_s(def, 2 / sharp_s);
    assert_true(dt_s > 1.01 * sharp_s); /* branches relax: the step of the sudden law is on the safe side */
    assert_true(growth(def, 2 / sharp_s, 0.99 * dt_s) < 1 && growth(def, 2 / sharp_s, 1.01 * dt_s) > 1.01);
    b.world->guaranteed_step_s = HUGE_VAL; /* and no limit of the stage, which covers every strain */
    for (int32_t i = 0; i < b.world->stage_count; i++) b.world->entry[i].stage.step_limit_s = 0;
    fix_ok(tm_world_set_step(b.world, share * dt_s, &error), &error);
    tm_state *s = tm_world_state(b.world);
    for (int32_t i = 0; i < b.n; i++) s->u_m[i] = s->u_prev_m[i] = 1e-9 * SIDE_M * fix_signed(&random);
    const double before = fix_largest(s->u_m, b.n);
    const int steps = share < 1 ? 20000 : 100;
    tm_status status = TM_OK;
    for (int k = 0; k < steps && !status && fix_largest(s->u_m, b.n) < 1e3 * before; k += 20)
        status = tm_world_step(b.world, 20);
    const double left = status ? HUGE_VAL : fix_largest(s->u_m, b.n) / before;
    destroy(&b);
    return left;
}

static void the_critical_step_is_that_of_the_amplification_matrix(void **state) {
    (void)state;
    static const tm_law_kind laws[] = {TM_LAW_NEO_HOOKE, TM_LAW_FUNG, TM_LAW_ST_VENANT_KIRCHHOFF};
    for (int k = 0; k < 3; k++) {
        const tm_viscosity_def def = series(0.3, k ? 2e-4 : 5e-4);
        const double below = left_after(laws[k], &def, 0.99), above = left_after(laws[k], &def, 1.2);
        print_message("%s: %.2g of the start at 0.99 of the critical step, %.2g at 1.2\n", tm_law_name(laws[k]), below,
                      above);
        assert_true(below < 20 && above >= 1e3);
    }
}

/* The stage leaves what histories may add to the tangent: more than the default share of the law's step. */
static void the_stage_limits_the_step(void **state) {
    (void)state;
    const tm_viscosity_def def = series(0.3, 0.01);
    body b = box((int[]){2, 2, 2}, (double[]){SIDE_M, SIDE_M, SIDE_M}, TM_LAW_NEO_HOOKE, &def);
    const double law_s = b.world->guaranteed_step_s;
    tm_error error;
    fix_ok(tm_world_set_step(b.world, 0.93 * law_s, &error), &error);
    assert_int_equal(tm_world_set_step(b.world, 0.94 * law_s, &error), TM_ERR_STEP);
    assert_non_null(strstr(error.message, "stage viscosity"));
    destroy(&b);
}

/* --- a beam --- */

static const double LENGTH_M = 0.05;

/* The first mode's part, by the shape of a cantilever, of masses. */
static double part_of(const body *b, const double *u, const double *shape) {
    const double *mass = tm_tissue_mass_kg(b->tissue);
    double sum = 0, whole = 0;
    for (int32_t i = 0; i < b->n; i++) sum += mass[i / 3] * shape[i] * u[i], whole += mass[i / 3] * shape[i] * shape[i];
    return sum / whole;
}

/* Twice as wide as high, so that no sideways mode is near. Frequency and decay, 1/s, by zeros and the peaks between
 * them, after the first. */
static double _Complex ring(tm_law_kind law, const tm_viscosity_def *terms, double bent) {
    body b = box((int[]){10, 3, 2}, (double[]){LENGTH_M, 0.02, 0.01}, law, terms);
    tm_error error;
    tm_state *s = tm_world_state(b.world);
    double *shape = malloc(sizeof *shape * (size_t)b.n), zero_s[9] = {0}, peak[9] = {0}, last, top = 0, before = bent;
    for (int32_t v = 0; v < b.n; v += 3) {
        const double x = b.mesh->rest_m[v] / LENGTH_M, z = b.mesh->rest_m[v + 2] - 0.005;
        shape[v + 2] = LENGTH_M * x * x * (6 - 4 * x + x * x) / 3, shape[v + 1] = 0;
        shape[v] = -z * x * (12 - 12 * x + 4 * x * x) / 3;
        for (int i = 0; i < 3 && x < 1e-9; i++) hold(&b, v + i, 0);
    }
    support(&b);
    for (int32_t i = 0; i < b.n; i++) s->u_m[i] = s->u_prev_m[i] = bent * shape[i];
    last = part_of(&b, s->u_m, shape);
    for (int found = 0; found < 9;) {
        fix_ok(tm_world_step(b.world, 1), &error);
        const double now = part_of(&b, s->u_m, shape);
        top = fmax(top, fabs(now));
        if (now * last < 0 && top > 0.3 * before) { /* other modes cross zero too, by little */
            zero_s[found++] = s->time_s - s->dt_s * now / (now - last);
            before = top, top = 0;
        }
        if (found > 0 && found < 9) peak[found] = fmax(peak[found], fabs(now));
        last = now;
    }
    free(shape);
    destroy(&b);
    const double period_s = (zero_s[8] - zero_s[0]) / 4;
    return 2 * acos(-1) / period_s * _Complex_I - log(peak[1] / peak[7]) / (3 * period_s);
}

/* With equal shares every mode of linear tissue has s^2 + w^2 (1 - sum g_i/(1 + s time_i)) = 0. */
static double _Complex linear_root(const tm_viscosity_def *def, double omega_1_s) {
    double _Complex s = omega_1_s * _Complex_I;
    for (int k = 0; k < 500; k++) {
        double _Complex left = 1;
        for (int t = 0; t < def->count; t++) left -= def->term[t].shear / (1 + s * def->term[t].time_s);
        s = 0.5 * (s + omega_1_s * _Complex_I * csqrt(left));
    }
    return s;
}

static void a_beam_has_the_period_and_decrement(void **state) {
    (void)state;
    const tm_viscosity_def def = series(0.15, 0.08);
    const double _Complex free = ring(TM_LAW_LINEAR, NULL, 1e-3), root = linear_root(&def, cimag(free));
    for (int k = 0; k < 2; k++) {
        const double _Complex found = ring(TM_LAW_NEO_HOOKE, &def, k ? 0.1 : 1e-3);
        const double decrement = -2 * acos(-1) * creal(found) / cimag(found),
                     expected = -2 * acos(-1) * creal(root) / cimag(root);
        print_message("neo-Hooke, bent by %g: period %.4f s (linear %.4f), decrement %.4f (%.4f)\n", k ? 0.1 : 1e-3,
                      2 * acos(-1) / cimag(found), 2 * acos(-1) / cimag(root), decrement, expected);
        assert_true(fabs(cimag(found) / cimag(root) - 1) < 0.03 && fabs(decrement / expected - 1) < 0.03);
    }
    assert_true(fabs(creal(free)) < 0.03 * fabs(creal(root)));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_critical_step_is_that_of_the_amplification_matrix),
                                       cmocka_unit_test(the_stage_limits_the_step),
                                       cmocka_unit_test(a_beam_has_the_period_and_decrement)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
