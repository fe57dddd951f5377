/* The interface of constitutive laws: energy, force, tangent and the bound of the tangent, over all active tetrahedra
 * of a field in batches of eight. Nonlinear laws share it (hyperelastic_law.c): such a law is one file, NAME_law.h, and
 * one row of TM_NONLINEAR_LAWS. tests/physics/test_laws.c checks every row: energy against force, force against
 * tangent, objectivity, symmetry of fibres, the bound, plain against SIMD. */
#ifndef TM_LAW_H
#define TM_LAW_H

#include "material/hyperelastic.h"

struct tm_law;

/* A field under one law, and work space of one evaluation. Elastic: no history. */
typedef struct tm_law_state {
    const struct tm_law *law;
    tm_material_field field;
    tm_tet_batches batches;
    tm_nodal_dilatation averages;
    tm_viscous work;
    tm_hyperelastic hyper; /* of nonlinear laws, with work.corner_N */
} tm_law_state;

typedef struct tm_law {
    const char *name;
    tm_law_kind kind;          /* of a material; rows of the linear one differ by the field */
    bool has_constant_tangent; /* stiffness tensors are its fast path (tissue/force.c) */
    bool is_objective;         /* no energy by rigid rotation */
    bool averages;             /* dilatation is averaged around vertices: for a smoothed field */
    /* Returns the energy of all active tetrahedra, J. */
    double (*energy)(const tm_law_state *state, const double *u_m);
    /* force_N -= its derivative. Every form is bit-identical to the plain one. */
    void (*force)(const tm_law_state *state, bool plain, const double *u_m, double *force_N);
    /* change_N -= its second derivative along d_m: the change of the force. */
    void (*tangent)(const tm_law_state *state, const double *u_m, const double *d_m, double *change_N);
    /* Returns an upper bound of the largest eigenvalue of M_e^-1 K_e in any state, 1/s2, with any masses (or weights) >
     * 0 on the vertices. No assembled system has a larger one than the largest of its tetrahedra (Irons). */
    double (*bound)(const tm_material_field *field, int32_t tet, const double mass_kg[4]);
} tm_law;

extern const tm_law tm_law_linear, tm_law_corotated, tm_law_corotated_averaged;
#define TM_LAW_DECLARE(NAME, name) extern const tm_law tm_law_##name;
TM_NONLINEAR_LAWS(TM_LAW_DECLARE)
/* All rows, null after the last. */
extern const tm_law *const tm_laws[];
/* Returns the law of a field. */
const tm_law *tm_law_of(const tm_material_field *field);
/* Returns the law of one tetrahedron: that of the field, or the linear one where rotation does not act. */
const tm_law *tm_law_of_tet(const tm_material_field *field, int32_t tet);

/* Initialises from the pool; returns false without memory. */
bool tm_law_init(tm_law_state *state, tm_pool *pool, const tm_law *law, const tm_material_field *field);

/* --- shared by the rows (law_batch.c) --- */

/* Adds the corner forces of all active tetrahedra, ascending. */
void tm_law_gather(const tm_law_state *state, double *force_N);

/* Computes the force by the passes over batches (kernel_forms.c), gathered in ascending order. */
void tm_law_batch_force(const tm_law_state *state, bool plain, const double *u_m, double *force_N);
/* Computes the gradient of a vector field in one tetrahedron, row by row; _add_stress adds the corner forces of a
 * stress P times the volume: force_N -= P alpha. */
void tm_law_gradient(const tm_mesh *mesh, int32_t tet, const double *u_m, double H[9]);
void tm_law_add_stress(const tm_mesh *mesh, int32_t tet, const double P[9], double *force_N);

/* Computes the derivative by F of one tetrahedron's dilatation, at the last evaluation: R of corotated tissue. */
void tm_law_slope(const tm_nodal_dilatation *averages, int32_t tet, double slope[9]);
/* Computes changes of the domains' pressures along d into `linear_Pa`, of the tetrahedra's contributions into
 * `linear_dilatation`: work space that the complete law does not use. */
void tm_law_change_pressures(const tm_law_state *state, const double *d_m);

/* linear_law.c. A = L^T G L with C = L L^T the elasticity of the tetrahedron, or a bound of it under any smoothing; G
 * of strains in Mandel form. */
void tm_linear_gram(const tm_material_field *field, int32_t tet, const double G[36], double A[36]);
/* G += scale B B^T: B maps a displacement to its strain in Mandel form, by the gradient alpha. */
void tm_strain_gram_add(const double alpha[3], double scale, double G[36]);
/* Returns an upper bound of the largest eigenvalue of G C, C semidefinite in Voigt form: at most 0.2 % too large. */
double tm_law_eigenvalue_over(const double law_Pa[36], const double G[36]);

#endif
