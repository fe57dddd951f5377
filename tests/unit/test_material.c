/* Material constants: conversions in both directions, rejections that name the inequality, the elasticity matrix
 * against its definition. */
#include "../fixture.h"

/* Solves C x = b, 6x6. */
static void solve6(const double C[36], const double b[6], double x[6]) {
    double A[6][7];
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++) A[i][j] = C[6 * i + j];
        A[i][6] = b[i];
    }
    for (int k = 0; k < 6; k++) {
        int pivot = k;
        for (int i = k + 1; i < 6; i++)
            if (fabs(A[i][k]) > fabs(A[pivot][k])) pivot = i;
        for (int j = 0; j < 7; j++) {
            const double t = A[k][j];
            A[k][j] = A[pivot][j], A[pivot][j] = t;
        }
        for (int i = 0; i < 6; i++)
            for (int j = 6; i != k && j >= k; j--) A[i][j] -= A[i][k] / A[k][k] * A[k][j];
    }
    for (int k = 0; k < 6; k++) x[k] = A[k][6] / A[k][k];
}

static void engineering_constants_convert_there_and_back(void **state) {
    (void)state;
    const double E_L = 30e3, E_T = 6e3, nu_LT = 0.4, nu_TT = 0.45, G = 5e3;
    tm_material m;
    tm_error error;
    fix_ok(tm_material_engineering(E_L, E_T, nu_LT, nu_TT, G, &m, &error), &error);
    double C[36], e[6];
    tm_material_voigt(&m, (double[3]){0, 0, 1}, C);
    solve6(C, (double[6]){0, 0, 1, 0, 0, 0}, e); /* tension along the fibre */
    assert_true(fabs(e[2] * E_L - 1) < 1e-12 && fabs(-e[0] / e[2] - nu_LT) < 1e-12 &&
                fabs(-e[1] / e[2] - nu_LT) < 1e-12);
    solve6(C, (double[6]){1, 0, 0, 0, 0, 0}, e); /* across */
    assert_true(fabs(e[0] * E_T - 1) < 1e-12 && fabs(-e[1] / e[0] - nu_TT) < 1e-12 &&
                fabs(-e[2] / e[0] - nu_LT * E_T / E_L) < 1e-12);
    solve6(C, (double[6]){0, 0, 0, 1, 0, 0}, e); /* axial shear, engineering strain */
    assert_true(fabs(e[3] * G - 1) < 1e-12);
    solve6(C, (double[6]){0, 0, 0, 0, 0, 1}, e); /* shear in the cross plane */
    assert_true(fabs(e[5] * E_T / (2 * (1 + nu_TT)) - 1) < 1e-12);
    /* Isotropic engineering constants are Young and Poisson. */
    tm_material iso, young;
    fix_ok(tm_material_engineering(1e4, 1e4, 0.3, 0.3, 1e4 / 2.6, &iso, &error), &error);
    fix_ok(tm_material_young(1e4, 0.3, &young, &error), &error);
    assert_true(fabs(iso.lambda_Pa / young.lambda_Pa - 1) < 1e-12 && fabs(iso.mu_Pa / young.mu_Pa - 1) < 1e-12);
    assert_true(fabs(iso.dlambda_Pa) < 1e-9 && fabs(iso.dmu_Pa) < 1e-9 && fabs(iso.beta_Pa) < 1e-8);
}

/* The energy density by its definition, from the strain tensor. */
static double density(const tm_material *m, const double a[3], const double E[3][3]) {
    double I1 = 0, I2 = 0, I4 = 0, I5 = 0;
    for (int i = 0; i < 3; i++) {
        double row = 0;
        for (int j = 0; j < 3; j++) row += E[i][j] * a[j], I2 += E[i][j] * E[i][j];
        I1 += E[i][i], I4 += a[i] * row, I5 += row * row;
    }
    return m->lambda_Pa / 2 * I1 * I1 + m->mu_Pa * I2 + m->dlambda_Pa * I1 * I4 + 2 * m->dmu_Pa * I5 +
           m->beta_Pa / 2 * I4 * I4;
}

static void matrix_is_the_energy(void **state) {
    (void)state;
    fix_random random = {3};
    tm_material m;
    tm_error error;
    fix_ok(tm_material_five(1e4, 3e3, 1.2e4, 9e3, 7e3, &m, &error), &error);
    for (int trial = 0; trial < 50; trial++) {
        double a[3], e[6], C[36], length = 0, w = 0;
        for (int i = 0; i < 3; i++) a[i] = fix_signed(&random), length += a[i] * a[i];
        for (int i = 0; i < 3; i++) a[i] /= sqrt(length);
        for (int i = 0; i < 6; i++) e[i] = fix_signed(&random);
        const double E[3][3] = {{e[0], e[5] / 2, e[4] / 2}, {e[5] / 2, e[1], e[3] / 2}, {e[4] / 2, e[3] / 2, e[2]}};
        tm_material_voigt(&m, a, C);
        for (int i = 0; i < 36; i++) {
            w += e[i / 6] * C[i] * e[i % 6] / 2;
            assert_true(C[i] == C[6 * (i % 6) + i / 6] || fabs(C[i] / C[6 * (i % 6) + i / 6] - 1) < 1e-12);
        }
        assert_true(fabs(w / density(&m, a, E) - 1) < 1e-12);
        /* The maximum stiffness bounds w over unit Mandel strain, and is reached. */
        double norm = 0;
        for (int i = 0; i < 6; i++) norm += e[i] * e[i] * (i < 3 ? 1 : 0.5);
        assert_true(2 * w <= tm_material_stiffest_Pa(&m) * norm * (1 + 1e-12));
    }
    fix_ok(tm_material_young(1e4, 0.3, &m, &error), &error);
    assert_true(fabs(tm_material_stiffest_Pa(&m) / (3 * m.lambda_Pa + 2 * m.mu_Pa) - 1) < 1e-12);
}

static void names(tm_status status, const tm_error *error, const char *const *says) {
    assert_int_equal(status, TM_ERR_MATERIAL);
    assert_int_equal(error->status, TM_ERR_MATERIAL);
    for (; *says; says++)
        if (!strstr(error->message, *says)) fail_msg("'%s' is not in: %s", *says, error->message);
    assert_non_null(strstr(error->message, "; "));
}
#define NAMES(...)                                                                                                     \
    (const char *const[]) { __VA_ARGS__, NULL }

static void invalid_constants_are_rejected_with_their_inequality(void **state) {
    (void)state;
    tm_material m = {.mu_Pa = -77};
    tm_error e;
    names(tm_material_young(-5, 0.3, &m, &e), &e, NAMES("E = -5", "E > 0"));
    names(tm_material_young(1e4, 0.5, &m, &e), &e, NAMES("nu = 0.5", "nu < 0.5"));
    names(tm_material_young(1e4, -1, &m, &e), &e, NAMES("nu = -1", "-1 < nu"));
    names(tm_material_young(1e4, NAN, &m, &e), &e, NAMES("nan"));
    names(tm_material_lame(1e4, 0, &m, &e), &e, NAMES("mu_T = 0", "mu_T > 0"));
    names(tm_material_lame(-1e4, 1e4, &m, &e), &e, NAMES("3 lambda + 2 mu > 0"));
    names(tm_material_five(1e4, 3e3, 1e4, -1, 0, &m, &e), &e, NAMES("mu_L = -1", "mu_L > 0"));
    names(tm_material_five(1e4, 3e3, 1e4, 3e3, -2e4, &m, &e), &e, NAMES("beta = -20000", "C33", "> 0"));
    names(tm_material_five(1e4, 3e3, 3e4, 3e3, 0, &m, &e), &e,
          NAMES("lambda_L = 30000", "(lambda_T + mu_T) C33 > C13^2"));
    names(tm_material_engineering(-1, 1, 0.3, 0.3, 1, &m, &e), &e, NAMES("E_L = -1", "E_L > 0"));
    names(tm_material_engineering(1e4, 1e4, 0.3, 1, 1e3, &m, &e), &e, NAMES("nu_TT = 1", "nu_TT < 1"));
    names(tm_material_engineering(6e3, 3e4, 0.4, 0.45, 5e3, &m, &e), &e, NAMES("nu_LT = 0.4", "2 nu_LT^2"));
    names(tm_material_engineering(1e4, 1e4, INFINITY, 0.3, 1e3, &m, &e), &e, NAMES("nu_LT = inf"));
    assert_true(m.mu_Pa == -77);
    /* The paper's law: the cap for one Poisson ratio, with its figure (design: 3.89 at 0.3, 1.06 at 0.49). */
    const double nu[2] = {0.3, 0.49};
    const char *const cap[2] = {"3.89", "1.06"};
    for (int i = 0; i < 2; i++) {
        const double mu = 3e3, lambda = 2 * mu * nu[i] / (1 - 2 * nu[i]);
        const double most = (lambda + mu) * (lambda + 2 * mu) / (lambda * lambda);
        fix_ok(tm_material_paper(lambda, mu, lambda * most * 0.999, mu * most * 0.999, &m, &e), &e);
        names(tm_material_paper(lambda, mu, lambda * most * 1.001, mu * most * 1.001, &m, &e), &e,
              NAMES("capped at", cap[i], "lambda_L^2 is violated"));
    }
    fix_ok(tm_material_young(1e4, 0.3, &m, &e), &e);
    m.density_kg_m3 = 0;
    names(tm_material_check(&m, &e), &e, NAMES("density > 0"));
    m.density_kg_m3 = 1000, m.damping_1_s = -1;
    names(tm_material_check(&m, &e), &e, NAMES("damping >= 0"));
}

/* The sign of C's smallest eigenvalue agrees with the inequalities. */
static void definiteness_agrees_with_the_matrix(void **state) {
    (void)state;
    fix_random random = {5};
    int accepted = 0, trials = 2000;
    for (int trial = 0; trial < trials; trial++) {
        tm_material m = {.lambda_Pa = 2e4 * fix_signed(&random),
                         .mu_Pa = 1e4 * fix_signed(&random) + 4e3,
                         .dlambda_Pa = 2e4 * fix_signed(&random),
                         .dmu_Pa = 1e4 * fix_signed(&random),
                         .beta_Pa = 4e4 * fix_signed(&random),
                         .density_kg_m3 = 1000};
        double C[36];
        tm_material_voigt(&m, (double[3]){0, 0, 1}, C);
        bool definite = true; /* Cholesky */
        for (int j = 0; j < 6 && definite; j++) {
            definite = C[7 * j] > 0;
            for (int i = j + 1; i < 6; i++)
                for (int k = j + 1; k < 6; k++) C[6 * i + k] -= C[6 * i + j] * C[6 * j + k] / C[7 * j];
        }
        assert_int_equal(tm_material_check(&m, NULL) == TM_OK, definite);
        accepted += definite;
    }
    assert_true(accepted > trials / 20 && accepted < trials - trials / 20);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(engineering_constants_convert_there_and_back),
                                       cmocka_unit_test(matrix_is_the_energy),
                                       cmocka_unit_test(invalid_constants_are_rejected_with_their_inequality),
                                       cmocka_unit_test(definiteness_agrees_with_the_matrix)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
