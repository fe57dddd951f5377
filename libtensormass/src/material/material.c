/* Constants: conversions, positive definiteness, laws, the elasticity matrix, the stiffness block. */
#include "material/law_facts.h"
#include "material/material_field.h"

#include <math.h>

enum { DEFAULT_DENSITY_KG_M3 = 1000 };

bool tm_material_is_isotropic(const tm_material *m) { return m->dlambda_Pa == 0 && m->dmu_Pa == 0 && m->beta_Pa == 0; }

static double c33(const tm_material *m) {
    return m->lambda_Pa + 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa;
}
static double c13(const tm_material *m) { return m->lambda_Pa + m->dlambda_Pa; }

static tm_status check_isotropic(const tm_material *m, tm_error *error) {
    if (!(3 * m->lambda_Pa + 2 * m->mu_Pa > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "lambda = %g Pa, mu = %g Pa: not positive definite, 3 lambda + 2 mu > 0 is "
                       "violated; raise lambda (Poisson's ratio above -1)",
                       m->lambda_Pa, m->mu_Pa);
    return TM_OK;
}

static tm_status check_definite(const tm_material *m, tm_error *error) {
    const double lT = m->lambda_Pa, mT = m->mu_Pa, lL = c13(m), mL = mT + m->dmu_Pa, C33 = c33(m);
    if (!(mT > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "mu_T = %g Pa: not positive definite, mu_T > 0 is violated; raise mu_T", mT);
    if (tm_material_is_isotropic(m)) return check_isotropic(m, error);
    if (!(mL > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "mu_L = %g Pa: not positive definite, mu_L > 0 is violated; raise mu_L", mL);
    if (!(C33 > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "lambda_T = %g, mu_T = %g, lambda_L = %g, mu_L = %g, beta = %g Pa: not positive "
                       "definite, C33 = %g > 0 is violated; raise beta or mu_L",
                       lT, mT, lL, mL, m->beta_Pa, C33);
    if (!((lT + mT) * C33 > lL * lL))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "lambda_T = %g, mu_T = %g, lambda_L = %g, mu_L = %g, beta = %g Pa: not positive "
                       "definite, (lambda_T + mu_T) C33 > C13^2 is violated: %g > %g; raise beta or lower lambda_L",
                       lT, mT, lL, mL, m->beta_Pa, (lT + mT) * C33, lL * lL);
    return TM_OK;
}

tm_status tm_material_check(const tm_material *m, tm_error *error) {
    TM_REQUIRE(m, "material is null", TM_ERR_ARGUMENT);
    const double value[7] = {m->lambda_Pa, m->mu_Pa,         m->dlambda_Pa, m->dmu_Pa,
                             m->beta_Pa,   m->density_kg_m3, m->damping_1_s};
    static const char *const name[7] = {"lambda", "mu", "dlambda", "dmu", "beta", "density", "damping"};
    for (int i = 0; i < 7; i++)
        if (!isfinite(value[i]))
            return tm_fail(error, TM_ERR_MATERIAL, -1, "%s = %g is not finite; give a number", name[i], value[i]);
    if (!(m->density_kg_m3 > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "density = %g kg/m3: density > 0 is violated; give a positive density", m->density_kg_m3);
    if (!(m->damping_1_s >= 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "damping = %g 1/s: damping >= 0 is violated, a negative rate feeds energy in; "
                       "give 0 or more",
                       m->damping_1_s);
    tm_status status = check_definite(m, error);
    if (!status) status = tm_law_check(m, error);
    if (!status && !tm_law_has_fibres((tm_law_kind)m->law) && !tm_material_is_isotropic(m))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "law %s has isotropic moduli, and dlambda = dmu = beta = 0 is violated: %g, %g, %g Pa; give an "
                       "isotropic family of constants, or another law",
                       tm_law_name((tm_law_kind)m->law), m->dlambda_Pa, m->dmu_Pa, m->beta_Pa);
    return status;
}

tm_status tm_material_set_law(tm_material *material, tm_law_kind law, const double *constant, double stretch_max,
                              tm_error *error) {
    TM_REQUIRE(material, "material is null", TM_ERR_ARGUMENT);
    tm_material m = *material;
    m.law = law;
    m.stretch_max = law == TM_LAW_LINEAR ? 0 : stretch_max != 0 ? stretch_max : TM_STRETCH_DEFAULT;
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) m.law_constant[i] = law != TM_LAW_LINEAR && constant ? constant[i] : 0;
    if (tm_law_name(law) && tm_law_facts_of[law]->limits) tm_law_facts_of[law]->limits(&m, stretch_max != 0);
    const tm_status status = tm_material_check(&m, error);
    if (!status) *material = m;
    return status;
}

/* Writes `out` only if the constants are valid. */
static tm_status accept(tm_material m, tm_material *out, tm_error *error) {
    TM_REQUIRE(out, "out is null", TM_ERR_ARGUMENT);
    m.density_kg_m3 = DEFAULT_DENSITY_KG_M3;
    const tm_status status = tm_material_check(&m, error);
    if (!status) *out = m;
    return status;
}

tm_status tm_material_lame(double lambda_Pa, double mu_Pa, tm_material *out, tm_error *error) {
    return accept((tm_material){.lambda_Pa = lambda_Pa, .mu_Pa = mu_Pa}, out, error);
}

tm_status tm_material_young(double young_Pa, double poisson, tm_material *out, tm_error *error) {
    if (!isfinite(young_Pa) || !(young_Pa > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1, "E = %g Pa: not positive definite, E > 0 is violated; raise E",
                       young_Pa);
    if (!(poisson > -1 && poisson < 0.5))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "nu = %g: not positive definite, -1 < nu < 0.5 is violated; use for instance "
                       "0.49 for nearly incompressible tissue",
                       poisson);
    return tm_material_lame(young_Pa * poisson / ((1 + poisson) * (1 - 2 * poisson)), young_Pa / (2 * (1 + poisson)),
                            out, error);
}

tm_status tm_material_five(double lambda_T_Pa, double mu_T_Pa, double lambda_L_Pa, double mu_L_Pa, double beta_Pa,
                           tm_material *out, tm_error *error) {
    return accept((tm_material){.lambda_Pa = lambda_T_Pa,
                                .mu_Pa = mu_T_Pa,
                                .dlambda_Pa = lambda_L_Pa - lambda_T_Pa,
                                .dmu_Pa = mu_L_Pa - mu_T_Pa,
                                .beta_Pa = beta_Pa},
                  out, error);
}

tm_status tm_material_paper(double lambda_T_Pa, double mu_T_Pa, double lambda_L_Pa, double mu_L_Pa, tm_material *out,
                            tm_error *error) {
    const double beta = -((lambda_L_Pa - lambda_T_Pa) + 2 * (mu_L_Pa - mu_T_Pa));
    const tm_status status = tm_material_five(lambda_T_Pa, mu_T_Pa, lambda_L_Pa, mu_L_Pa, beta, out, error);
    const double C33 = lambda_L_Pa + 2 * mu_L_Pa;
    if (status && mu_T_Pa > 0 && mu_L_Pa > 0 && C33 > 0 && lambda_T_Pa != 0 && isfinite(beta)) {
        /* One Poisson ratio for both sets: r (lT+mT)(lT+2mT) > r^2 lT^2. */
        const double cap = (lambda_T_Pa + mu_T_Pa) * (lambda_T_Pa + 2 * mu_T_Pa) / (lambda_T_Pa * lambda_T_Pa);
        return tm_fail(
            error, status, -1,
            "lambda_T = %g, mu_T = %g, lambda_L = %g, mu_L = %g Pa: not positive definite, (lambda_T + "
            "mu_T)(lambda_L + 2 mu_L) > lambda_L^2 is violated: %g > %g; with the paper's beta and one Poisson ratio "
            "(%.3g) "
            "the stiffness ratio is capped at %.2f: lower lambda_L, or give five constants, whose beta is free",
            lambda_T_Pa, mu_T_Pa, lambda_L_Pa, mu_L_Pa, (lambda_T_Pa + mu_T_Pa) * C33, lambda_L_Pa * lambda_L_Pa,
            lambda_T_Pa / (2 * (lambda_T_Pa + mu_T_Pa)), cap);
    }
    return status;
}

tm_status tm_material_engineering(double E_L_Pa, double E_T_Pa, double nu_LT, double nu_TT, double G_L_Pa,
                                  tm_material *out, tm_error *error) {
    const double value[5] = {E_L_Pa, E_T_Pa, G_L_Pa, nu_LT, nu_TT};
    static const char *const name[5] = {"E_L", "E_T", "G_L", "nu_LT", "nu_TT"};
    for (int i = 0; i < 5; i++)
        if (!isfinite(value[i]) || (i < 3 && !(value[i] > 0)))
            return tm_fail(error, TM_ERR_MATERIAL, -1,
                           "%s = %g: not positive definite, %s %s is violated; give a %s number", name[i], value[i],
                           name[i], i < 3 ? "> 0" : "finite", i < 3 ? "positive" : "finite");
    if (!(nu_TT > -1 && nu_TT < 1))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "nu_TT = %g: not positive definite, -1 < nu_TT < 1 is violated; lower its size", nu_TT);
    const double S11 = 1 / E_T_Pa, S12 = -nu_TT / E_T_Pa, S13 = -nu_LT / E_L_Pa, S33 = 1 / E_L_Pa;
    const double D = (S11 + S12) * S33 - 2 * S13 * S13;
    if (!(D > 0))
        return tm_fail(error, TM_ERR_MATERIAL, -1,
                       "E_L = %g, E_T = %g Pa, nu_LT = %g, nu_TT = %g: not positive definite, (1 - nu_TT) "
                       "E_L/E_T > 2 nu_LT^2 is violated: %g > %g; lower nu_LT",
                       E_L_Pa, E_T_Pa, nu_LT, nu_TT, (1 - nu_TT) * E_L_Pa / E_T_Pa, 2 * nu_LT * nu_LT);
    const double mu = 1 / (2 * (S11 - S12)), lambda = S33 / (2 * D) - mu; /* C11 + C12 = S33/D, C11 - C12 = 2 mu */
    const double C13 = -S13 / D, C33 = (S11 + S12) / D, dlambda = C13 - lambda, dmu = G_L_Pa - mu;
    return accept((tm_material){.lambda_Pa = lambda,
                                .mu_Pa = mu,
                                .dlambda_Pa = dlambda,
                                .dmu_Pa = dmu,
                                .beta_Pa = C33 - lambda - 2 * mu - 2 * dlambda - 4 * dmu},
                  out, error);
}

double tm_material_stiffest_Pa(const tm_material *m) {
    /* Mandel form, fibre along z: two shears, one plane shear, and the 2x2 of (xx+yy)/sqrt2 and zz. */
    const double a = 2 * (m->lambda_Pa + m->mu_Pa), b = sqrt(2.0) * c13(m), c = c33(m);
    const double pair = (a + c) / 2 + sqrt((a - c) * (a - c) / 4 + b * b);
    return fmax(pair, 2 * fmax(m->mu_Pa, m->mu_Pa + m->dmu_Pa));
}

double tm_material_bulk_Pa(const tm_material *m) {
    const double across = m->lambda_Pa + m->mu_Pa, mixed = m->lambda_Pa + m->dlambda_Pa;
    const double along = m->lambda_Pa + 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa;
    return (across * along - mixed * mixed) / (along - 2 * mixed + across);
}

tm_material tm_material_relaxed(const tm_material *m, double shear, double volume) {
    const double bulk = tm_material_bulk_Pa(m);
    tm_material left = *m;
    left.mu_Pa *= shear, left.dlambda_Pa *= shear, left.dmu_Pa *= shear, left.beta_Pa *= shear;
    left.lambda_Pa = shear * (m->lambda_Pa - bulk) + volume * bulk;
    return left;
}

void tm_material_voigt(const tm_material *m, const double fibre[3], double C[36]) {
    static const int at[6][2] = {{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
    const double zero[3] = {0, 0, 0}, *a = fibre ? fibre : zero;
    for (int I = 0; I < 6; I++)
        for (int J = 0; J < 6; J++) {
            const int i = at[I][0], j = at[I][1], k = at[J][0], l = at[J][1];
            const double ij = i == j, kl = k == l, ik = i == k, jl = j == l, il = i == l, jk = j == k;
            C[6 * I + J] = m->lambda_Pa * ij * kl + m->mu_Pa * (ik * jl + il * jk) +
                           m->dlambda_Pa * (ij * a[k] * a[l] + a[i] * a[j] * kl) +
                           m->dmu_Pa * (a[i] * a[k] * jl + a[i] * a[l] * jk + a[j] * a[k] * il + a[j] * a[l] * ik) +
                           m->beta_Pa * a[i] * a[j] * a[k] * a[l];
        }
}

void tm_stiffness_block(const tm_material *m, const double fibre[3], double volume_m3, const double alpha_k[3],
                        const double alpha_l[3], double K[9]) {
    const double lambda = m->lambda_Pa * volume_m3, mu = m->mu_Pa * volume_m3, product = vdot(alpha_k, alpha_l);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) K[3 * i + j] = lambda * alpha_k[i] * alpha_l[j] + mu * alpha_l[i] * alpha_k[j];
    for (int i = 0; i < 3; i++) K[4 * i] += mu * product;
    if (!fibre || tm_material_is_isotropic(m)) return;

    const double dlambda = m->dlambda_Pa * volume_m3, dmu = m->dmu_Pa * volume_m3, beta = m->beta_Pa * volume_m3;
    const double pk = vdot(fibre, alpha_k), pl = vdot(fibre, alpha_l);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            K[3 * i + j] += dlambda * (pk * fibre[i] * alpha_l[j] + pl * alpha_k[i] * fibre[j]) +
                            dmu * (pk * alpha_l[i] * fibre[j] + pl * fibre[i] * alpha_k[j]) +
                            (dmu * product + beta * pk * pl) * fibre[i] * fibre[j];
    for (int i = 0; i < 3; i++) K[4 * i] += dmu * pk * pl;
}
