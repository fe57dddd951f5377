/* Material constants of linear, transversely isotropic tissue, conversions from common forms, and nonlinear laws. */
#ifndef TENSORMASS_MATERIAL_H
#define TENSORMASS_MATERIAL_H

#include "base.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Nonlinear laws, a row each: constant and file (libtensormass/src/material/NAME_law.h, with its formula, constants and
 * source). Everything else follows from the row; a new one comes last, as values are part of the interface. */
#define TM_NONLINEAR_LAWS(ROW)                                                                                         \
    ROW(NEO_HOOKE, neo_hooke)                                                                                          \
    ROW(ST_VENANT_KIRCHHOFF, st_venant_kirchhoff)                                                                      \
    ROW(MOONEY_RIVLIN, mooney_rivlin)                                                                                  \
    ROW(FUNG, fung)                                                                                                    \
    ROW(HOLZAPFEL, holzapfel)

/* Constitutive laws: TM_LAW_LINEAR, TM_LAW_NEO_HOOKE ... At small strain each of them follows the material's elastic
 * constants (docs/nonlinear-laws.md). */
#define TM_LAW_VALUE(NAME, name) TM_LAW_##NAME,
typedef enum tm_law_kind {
    TM_LAW_LINEAR = 0,
    TM_NONLINEAR_LAWS(TM_LAW_VALUE) /* 1, 2 ... */
    TM_LAW_COUNT
} tm_law_kind;
#undef TM_LAW_VALUE
enum { TM_LAW_CONSTANTS = 4 };

/* A further constant of a law: its key in scenes, and its meaning. */
typedef struct tm_law_constant {
    const char *name;
    const char *unit;     /* "pressure", Pa, or "none" */
    const char *fallback; /* value in a scene that does not give it; null: it must be given */
    double min, max;      /* SI, inclusive */
    double example;       /* a value that tests use */
    const char *doc;
} tm_law_constant;

/* w = lambda/2 I1^2 + mu tr E^2 + dlambda I1 I4 + 2 dmu I5 + beta/2 I4^2     (docs/physics.md, eq. 1)
 * Isotropic tissue has dlambda = dmu = beta = 0 and needs no fibre. */
typedef struct tm_material {
    double lambda_Pa, mu_Pa; /* transverse Lame coefficients */
    double dlambda_Pa;       /* lambda_L - lambda_T */
    double dmu_Pa;           /* mu_L - mu_T */
    double beta_Pa;          /* in the paper's law: -(dlambda + 2 dmu) */
    double density_kg_m3;    /* > 0 */
    double damping_1_s;      /* rate d >= 0: gamma_i = d m_i */
    /* Set by tm_material_set_law; all 0: linear. */
    int64_t law; /* tm_law_kind; 64 bits to avoid padding, as materials are hashed */
    double law_constant[TM_LAW_CONSTANTS];
    double stretch_max;
} tm_material;

/* Build a material. TM_ERR_MATERIAL: constants that are not positive definite; the message names constants and
 * inequality. Density is set to 1000 kg/m3 and damping to 0; change them afterwards. */
TM_API tm_status tm_material_lame(double lambda_Pa, double mu_Pa, tm_material *out, tm_error *error);
TM_API tm_status tm_material_young(double young_Pa, double poisson, tm_material *out, tm_error *error);
/* Takes the paper's four constants; beta = -(dlambda + 2 dmu). */
TM_API tm_status tm_material_paper(double lambda_T_Pa, double mu_T_Pa, double lambda_L_Pa, double mu_L_Pa,
                                   tm_material *out, tm_error *error);
/* Takes five constants: beta is free. */
TM_API tm_status tm_material_five(double lambda_T_Pa, double mu_T_Pa, double lambda_L_Pa, double mu_L_Pa,
                                  double beta_Pa, tm_material *out, tm_error *error);
/* Takes five engineering constants: nu_LT = -eps_T/eps_L under tension along the fibre, nu_TT in the cross plane. */
TM_API tm_status tm_material_engineering(double E_L_Pa, double E_T_Pa, double nu_LT, double nu_TT, double G_L_Pa,
                                         tm_material *out, tm_error *error);

/* Limit of a nonlinear law, as uniaxial stretch at constant volume; beyond it force grows linearly. */
#define TM_STRETCH_DEFAULT 1.6
#define TM_STRETCH_LEAST 1.2
#define TM_STRETCH_MOST 4
/* Sets a nonlinear law on a material whose elastic constants are set. `constant` [TM_LAW_CONSTANTS] or null: the law's
 * further constants. stretch_max 0: the default. TM_ERR_MATERIAL: constants that are not stable; the message names the
 * inequality, and the material is unchanged. */
TM_API tm_status tm_material_set_law(tm_material *material, tm_law_kind law, const double *constant, double stretch_max,
                                     tm_error *error);
/* Returns the name in scenes, "linear", "neo-hooke" ...; null: no such law. */
TM_API const char *tm_law_name(tm_law_kind law);
/* Returns constant `index` of the law, in the order of tm_material_set_law; null: it has no such constant. */
TM_API const tm_law_constant *tm_law_constant_at(tm_law_kind law, int32_t index);
/* Returns whether the law accepts moduli of fibres; and whether it has fibres with isotropic moduli too. */
TM_API bool tm_law_has_fibres(tm_law_kind law);
TM_API bool tm_law_needs_fibre(tm_law_kind law);

/* Checks the constants. Positive definite iff mu_T > 0, mu_L > 0, C33 > 0, (lambda_T + mu_T) C33 > C13^2; density > 0,
 * damping >= 0. */
TM_API tm_status tm_material_check(const tm_material *material, tm_error *error);
TM_API bool tm_material_is_isotropic(const tm_material *material);

/* Returns the largest stiffness: an eigenvalue bound of the 6x6 elasticity matrix in Mandel form, Pa. */
TM_API double tm_material_stiffest_Pa(const tm_material *material);

/* Computes the 6x6 elasticity matrix (Voigt, engineering shears xx yy zz yz xz xy) for the unit fibre a (null if
 * isotropic). */
TM_API void tm_material_voigt(const tm_material *material, const double fibre[3], double C[36]);

/* Computes the block K_kl (row-major 3x3, N/m) of one tetrahedron: the exact gradient of V*w. `fibre` null if
 * isotropic. */
TM_API void tm_stiffness_block(const tm_material *material, const double fibre[3], double volume_m3,
                               const double alpha_k[3], const double alpha_l[3], double K[9]);

#ifdef __cplusplus
}
#endif
#endif
