/* Viscosity of nonlinear laws: relaxation at any strain by the closed form, rotation invariance, no energy from
 * closed loops, equilibrium by the long-term law, small strains as in linear tissue, recovery of inverted
 * tetrahedra. */
#include "law_body.h"
#include "tensormass/energy.h"
#include "tensormass/viscosity.h"

typedef struct kind {
    tm_law_kind law;
    bool fibred, averaged;
} kind;
static const kind KINDS[] = {{TM_LAW_NEO_HOOKE, false, false},         {TM_LAW_ST_VENANT_KIRCHHOFF, true, false},
                             {TM_LAW_MOONEY_RIVLIN, false, false},     {TM_LAW_FUNG, true, false},
                             {TM_LAW_HOLZAPFEL, false, false},         {TM_LAW_NEO_HOOKE, false, true},
                             {TM_LAW_ST_VENANT_KIRCHHOFF, true, true}, {TM_LAW_HOLZAPFEL, false, true}};
enum { ALL = sizeof KINDS / sizeof *KINDS };

static tm_viscosity_def series(double shear, double bulk) {
    tm_viscosity_def def = tm_viscosity_def_default();
    def.count = 2;
    def.term[0] = (tm_viscosity_term){.time_s = 0.01, .shear = shear, .bulk = bulk};
    def.term[1] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.2, .bulk = 0.2};
    return def;
}

/* A world of a block of one kind, or of its linear twin. Tissue is reused between tests, as its bound is expensive. */
static body body_of(kind k, const tm_viscosity_def *terms, bool damped) {
    static struct {
        tm_mesh *mesh;
        tm_tissue *tissue;
    } all[TM_LAW_COUNT][2][2];
    fix_random random = {11};
    tm_error error;
    tm_mesh **mesh = &all[k.law][k.fibred][k.averaged].mesh;
    tm_tissue **tissue = &all[k.law][k.fibred][k.averaged].tissue;
    if (!*mesh) {
        const tm_material m = material_of(k.law, 0.45, k.fibred);
        *mesh = fix_block((int[]){2, 2, 2}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.2, &random);
        tm_tissue_def def = tm_tissue_def_default();
        double *fibre = fix_fibres(*mesh, FIBRE);
        def.mesh = *mesh, def.fibre = fibre, def.material_count = 1, def.material = &m;
        def.strain_smoothing = k.averaged, def.smoothed_shear_share = 0;
        fix_ok(tm_tissue_create(&def, tissue, &error), &error);
        free(fibre);
    }
    body b = world_of(*mesh, *tissue, 1, damped);
    if (terms) fix_ok(tm_stage_viscosity(b.world, terms, &error), &error);
    return b;
}

static void leave(body *b) {
    tm_world_destroy(b->world);
    free(b->dof);
    free(b->value_m);
}

/* Runs one step with all of the tissue at x = F X. Returns the mean stress there: -sum f X^T/V. */
static void drive(const body *b, const double F[9], double P_Pa[9]) {
    tm_state *s = tm_world_state(b->world);
    tm_error error;
    for (int32_t i = 0; i < b->n; i++) {
        const double *x = b->mesh->rest_m + i / 3 * 3, *row = F + 3 * (i % 3);
        s->u_m[i] = s->u_prev_m[i] = row[0] * x[0] + row[1] * x[1] + row[2] * x[2] - x[i % 3];
    }
    fix_ok(tm_world_step(b->world, 1), &error);
    for (int i = 0; i < 9; i++) {
        P_Pa[i] = 0;
        for (int32_t v = 0; v < b->n; v += 3)
            P_Pa[i] -= s->force_N[v + i / 3] * b->mesh->rest_m[v + i % 3] / (SIDE_M * SIDE_M * SIDE_M);
    }
}

static double size_of(const double P[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += P[i] * P[i];
    return sqrt(sum);
}

/* Returns the stress of the bulk modulus, kappa (J - 1) cof F. */
static void bulk_stress(const tm_material *m, const double F[9], double P_Pa[9]) {
    double J = 0, cof[9];
    for (int i = 0; i < 9; i++) {
        const int a = 3 * ((i / 3 + 1) % 3), b = 3 * ((i / 3 + 2) % 3), c = (i % 3 + 1) % 3, d = (i % 3 + 2) % 3;
        cof[i] = F[a + c] * F[b + d] - F[a + d] * F[b + c];
    }
    for (int j = 0; j < 3; j++) J += F[j] * cof[j];
    /* 1/(m.C^-1 m), as in strain smoothing; also for fibred tissue. */
    const double across = m->lambda_Pa + m->mu_Pa, mixed = m->lambda_Pa + m->dlambda_Pa;
    const double along = m->lambda_Pa + 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa;
    const double bulk = (across * along - mixed * mixed) / (along - 2 * mixed + across);
    for (int i = 0; i < 9; i++) P_Pa[i] = bulk * (J - 1) * cof[i];
}

/* Strained within one step, then held: each part of the instantaneous stress relaxes by its own share. */
static void relaxes(kind k, const double F[9]) {
    const tm_viscosity_def def = series(0.4, 0.1);
    const tm_material m = material_of(k.law, 0.45, k.fibred);
    body soft = body_of(k, &def, true), elastic = body_of(k, NULL, true);
    double sudden[9], bulk[9], P[9], dt_s = tm_world_step_s(soft.world);
    drive(&elastic, F, sudden);
    bulk_stress(&m, F, bulk);
    for (int step = 0; step < 60; step++) {
        double shear_share = 1, bulk_share = 1;
        drive(&soft, F, P);
        for (int t = 0; t < def.count; t++) {
            const double x = dt_s / def.term[t].time_s, faded = 1 - -expm1(-x) / x * exp(-x * step);
            shear_share -= def.term[t].shear * faded, bulk_share -= def.term[t].bulk * faded;
        }
        for (int i = 0; i < 9; i++)
            assert_true(fabs(P[i] - shear_share * (sudden[i] - bulk[i]) - bulk_share * bulk[i]) < 1e-9 * size_of(P));
        if (step == 59) assert_true(shear_share < 0.9);
    }
    leave(&soft), leave(&elastic);
}

static void relaxes_by_the_series_at_any_strain(void **state) {
    (void)state;
    for (int k = 0; k < ALL; k++) {
        relaxes(KINDS[k], (double[]){1.01, 0.002, 0, 0, 0.997, 0.001, 0, 0, 0.996});
        relaxes(KINDS[k], (double[]){1.3, 0.1, 0, 0.05, 0.88, 0, 0, 0.1, 0.9});
        relaxes(KINDS[k], (double[]){0.7, 0, 0, 0.05, 1.2, 0, 0, 0.1, 1.15});
    }
}

/* Rotated by two radians while it relaxes: the same stress, rotated. */
static void relaxation_is_rotation_invariant(void **state) {
    (void)state;
    const double F[9] = {1.25, 0.1, 0, 0.05, 0.9, 0, 0, 0.1, 0.92};
    const tm_viscosity_def def = series(0.4, 0.1);
    for (int k = 0; k < ALL; k++) {
        body still = body_of(KINDS[k], &def, true), turning = body_of(KINDS[k], &def, true);
        for (int step = 0; step < 40; step++) {
            const double c = cos(0.05 * step), s = sin(0.05 * step), R[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
            double RF[9] = {0}, RP[9] = {0}, P[9], Q[9];
            for (int i = 0; i < 27; i++) RF[i / 3] += R[i / 9 * 3 + i % 3] * F[i % 3 * 3 + i / 3 % 3];
            drive(&still, F, P), drive(&turning, RF, Q);
            for (int i = 0; i < 27; i++) RP[i / 3] += R[i / 9 * 3 + i % 3] * P[i % 3 * 3 + i / 3 % 3];
            for (int i = 0; i < 9; i++) assert_true(fabs(RP[i] - Q[i]) < 1e-9 * size_of(P));
        }
        leave(&still), leave(&turning);
    }
}

/* Closed strain loops of several relaxation times: tissue at rest never returns more energy than it received, and
 * each loop dissipates. */
static void strain_loops_gain_no_energy(void **state) {
    (void)state;
    enum { STEPS = 400, LOOPS = 3 };
    const tm_viscosity_def def = series(0.5, 0.2);
    for (int k = 0; k < ALL; k++)
        for (int round = 0; round < 2; round++) {
            fix_random random = {(uint64_t)(31 + 7 * round)};
            body b = body_of(KINDS[k], &def, true);
            double last_F[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, last_P[9] = {0}, work = 0, most = 0, least = 0, A[18];
            for (int i = 0; i < 18; i++) A[i] = (i % 9 % 4 ? 0.25 : 0.2) * fix_signed(&random);
            for (int step = 0; step <= LOOPS * STEPS; step++) {
                const double turn = 2 * acos(-1) * step / STEPS;
                double F[9], P[9], done = 0;
                for (int i = 0; i < 9; i++)
                    F[i] = (i % 4 ? 0 : 1) + A[i] * sin(turn * (1 + round)) + A[9 + i] * 0.5 * (1 - cos(turn));
                drive(&b, F, P);
                for (int i = 0; i < 9; i++) done += 0.5 * (P[i] + last_P[i]) * (F[i] - last_F[i]);
                work += done, most = fmax(most, work), least = fmin(least, work);
                memcpy(last_F, F, sizeof F), memcpy(last_P, P, sizeof P);
            }
            if (round == 0)
                print_message("%s%s: %.3f of the largest work is lost in loops\n", tm_law_name(KINDS[k].law),
                              KINDS[k].averaged ? ", averaged" : "", work / most);
            assert_true(least > -1e-4 * most && work > 0.02 * most);
            leave(&b);
        }
}

/* Small motions equal those of linear tissue. */
static void moves_like_linear_tissue_when_small(void **state) {
    (void)state;
    tm_error error;
    const tm_viscosity_def def = series(0.4, 0.1);
    for (int k = 0; k < ALL; k++) {
        kind linear = KINDS[k];
        linear.law = TM_LAW_LINEAR;
        fix_random random = {3};
        body a = body_of(KINDS[k], &def, true), b = body_of(linear, &def, true);
        if (KINDS[k].law == TM_LAW_HOLZAPFEL) { /* not linear where fibres begin to be stretched */
            leave(&a), leave(&b);
            continue;
        }
        fix_ok(tm_world_set_step(b.world, tm_world_step_s(a.world), &error), &error);
        tm_state *s = tm_world_state(a.world), *t = tm_world_state(b.world);
        for (int32_t i = 0; i < a.n; i++)
            s->u_m[i] = t->u_m[i] = 0, s->u_prev_m[i] = t->u_prev_m[i] = 1e-7 * SIDE_M * fix_signed(&random);
        fix_ok(tm_world_step(a.world, 200), &error);
        fix_ok(tm_world_step(b.world, 200), &error);
        const double size = fix_largest(t->u_m, a.n);
        for (int32_t i = 0; i < a.n; i++) assert_true(fabs(s->u_m[i] - t->u_m[i]) < 1e-3 * size);
        leave(&a), leave(&b);
    }
}

/* Pressed and sheared by its top: equilibrium follows the long-term law, the instantaneous moduli times the
 * remaining share, and steps do not leave it. */
static void rests_by_the_long_term_law(void **state) {
    (void)state;
    tm_error error;
    for (int k = 0; k < ALL; k++)
        for (int unlike = 0; unlike < 2; unlike++) {
            const tm_viscosity_def def = series(0.3, unlike ? 0.05 : 0.3);
            body soft = body_of(KINDS[k], &def, true), elastic = body_of(KINDS[k], NULL, true),
                 *both[2] = {&soft, &elastic};
            double top_N[2] = {0};
            for (int i = 0; i < 2; i++) {
                body *b = both[i];
                for (int32_t v = 0; v < b->n; v++) {
                    const int32_t z = v / 3 * 3 + 2;
                    if (is_at(b, z, 0) || is_at(b, z, SIDE_M))
                        hold(b, v, is_at(b, z, 0) ? 0 : (v % 3 == 2 ? -0.2 : 0.1) * SIDE_M);
                }
                settle(b);
                double *reaction = malloc(sizeof *reaction * (size_t)soft.n);
                memset(reaction, 0, sizeof *reaction * (size_t)soft.n);
                tm_support_reaction(b->world, reaction);
                for (int32_t v = 2; v < b->n; v += 3) top_N[i] += is_at(b, v, SIDE_M) ? reaction[v] : 0;
                free(reaction);
            }
            const double *u = tm_world_state(soft.world)->u_m, *w = tm_world_state(elastic.world)->u_m;
            double apart = 0, before[3 * 64];
            for (int32_t i = 0; i < soft.n; i++) apart = fmax(apart, fabs(u[i] - w[i])), before[i] = u[i];
            /* With equal shares all moduli fall alike; otherwise the tissue becomes more nearly incompressible. */
            assert_true(unlike ? apart > 1e-4 * SIDE_M : apart < 1e-6 * SIDE_M);
            if (!unlike) assert_true(fabs(top_N[0] - 0.5 * top_N[1]) < 1e-6 * fabs(top_N[1]));
            fix_ok(tm_world_step(soft.world, 100), &error);
            u = tm_world_state(soft.world)->u_m;
            for (int32_t i = 0; i < soft.n; i++) assert_true(fabs(u[i] - before[i]) < 1e-7 * SIDE_M);
            leave(&soft), leave(&elastic);
        }
}

/* Released from a stretch without damping: the account closes, the terms' work is dissipated, and the tissue comes
 * to rest. */
static void loses_energy_by_the_account(void **state) {
    (void)state;
    tm_error error;
    tm_energy e;
    const tm_viscosity_def def = series(0.5, 0.3);
    for (int k = 0; k < ALL; k++) {
        body b = body_of(KINDS[k], &def, false);
        tm_state *s = tm_world_state(b.world);
        fix_ok(tm_stage_energy(b.world, &error), &error);
        for (int32_t i = 0; i < b.n; i++)
            s->u_m[i] = s->u_prev_m[i] = (i % 3 == 2 ? 0.3 : -0.12) * (b.mesh->rest_m[i] - SIDE_M / 2);
        for (int part = 0; part < 10; part++) {
            fix_ok(tm_world_step(b.world, (int32_t)(0.05 / s->dt_s)), &error);
            fix_ok(tm_world_energy(b.world, &e, &error), &error);
            assert_true(fabs(e.residual_J) < 5e-3 * e.start_J && e.load_J < 0);
        }
        assert_true(e.kinetic_J + e.elastic_J < 0.1 * e.start_J);
        leave(&b);
    }
}

/* Inverted tissue recovers. */
static void inverted_tissue_recovers(void **state) {
    (void)state;
    tm_error error;
    const tm_viscosity_def def = series(0.4, 0.3);
    for (int k = 0; k < ALL; k += 4) {
        fix_random random = {3};
        tm_material m = material_of(KINDS[k].law, 0.45, false);
        m.damping_1_s = 40;
        tm_tissue_def tissue = tm_tissue_def_default();
        tissue.material_count = 1, tissue.material = &m;
        body b = make(fix_block((int[]){3, 3, 3}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0.2, &random), tissue, 1, true);
        tm_state *s = tm_world_state(b.world);
        for (int32_t i = 0; i < b.n; i++)
            if (is_at(&b, i / 3 * 3 + 2, 0)) hold(&b, i, 0);
        support(&b);
        fix_ok(tm_stage_viscosity(b.world, &def, &error), &error);
        for (int32_t i = 0; i < b.n; i++)
            if (!is_at(&b, i / 3 * 3 + 2, 0)) s->u_m[i] = s->u_prev_m[i] = 0.4 * SIDE_M * fix_signed(&random);
        assert_true(tm_tissue_deformation(b.tissue, s->u_m).inverted > 20);
        fix_ok(tm_world_step(b.world, (int32_t)(2.5 / s->dt_s)), &error);
        print_message("%s: %.1e of the side from rest\n", tm_law_name(KINDS[k].law), fix_largest(s->u_m, b.n) / SIDE_M);
        assert_true(fix_largest(s->u_m, b.n) < 1e-3 * SIDE_M);
        destroy(&b);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(relaxes_by_the_series_at_any_strain),
        cmocka_unit_test(relaxation_is_rotation_invariant),
        cmocka_unit_test(strain_loops_gain_no_energy),
        cmocka_unit_test(moves_like_linear_tissue_when_small),
        cmocka_unit_test(rests_by_the_long_term_law),
        cmocka_unit_test(loses_energy_by_the_account),
        cmocka_unit_test(inverted_tissue_recovers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
