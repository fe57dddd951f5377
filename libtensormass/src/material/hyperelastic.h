/* Nonlinear laws of a field, one per material, in batches of eight tetrahedra. */
#ifndef TM_HYPERELASTIC_H
#define TM_HYPERELASTIC_H

#include "material/material_internal.h"

/* Band in which a stretch beyond the limit is scaled back, as a share of |F| there. */
#define TM_STRETCH_BAND 0.15

typedef struct tm_law_pack {
    double constant[TM_LAW_CONSTANTS][TM_LANES]; /* times the volume where the law's constant is in Pa */
    double dlambda_J[TM_LANES], dmu_J[TM_LANES], beta_J[TM_LANES];
    double fibre[3][TM_LANES];
    double I3_max[TM_LANES]; /* |F|^2 - 3 at the limit of stretch */
    int64_t law[TM_LANES];   /* tm_law_kind */
    uint32_t laws;           /* a bit for each law of its lanes */
} tm_law_pack;

typedef struct tm_hyperelastic {
    tm_tet_batches packs;
    const tm_law_pack *law; /* [packs.count] */
    bool averaged;          /* dilatation by domains; the batches have the rest of the law */
    /* With viscosity, else null: [TM_LANES*packs.count] bulk modulus times volume, 0 where it is averaged; and the
     * shares of the law and of the bulk modulus, which settling sets to the long-term ones, else 1. */
    const double *bulk_J;
    double shear, volume;
    /* Limits of what histories store, with bulk_J: [TM_LANES*packs.count] second Piola stress and pressure, times the
     * volume; infinite of the linear law. */
    const double *history_stress_J, *history_pressure_J[2];
} tm_hyperelastic;

/* Initialises from the pool; returns false without memory. */
bool tm_hyperelastic_take(tm_hyperelastic *h, tm_pool *pool, const tm_material_field *field);

/* Computes corner_N [12*TM_LANES*(end-begin)], the corner forces of the batches [begin, end). Returns how many
 * tetrahedra are beyond a limit, where the law is continued linearly. Every form is bit-identical to the plain one. */
typedef int32_t (*tm_hyper_force)(const tm_hyperelastic *h, int32_t begin, int32_t end, const double *u_m,
                                  double *corner_N);
/* 0 plain, 1 AVX2 or NEON, 2 AVX-512; null: not supported by this processor. */
tm_hyper_force tm_hyper_force_form(int form);
tm_hyper_force tm_hyper_force_choose(bool plain);

/* The complete pass, with terms of `v` (none: v->terms is 0): v->corner_N; with averaged dilatation
 * (nodal_dilatation.h) v->stress_J of the rest of the law, dilatations, and their derivatives by F in place of
 * rotations. */
typedef int32_t (*tm_hyper_strain)(const tm_hyperelastic *h, const tm_viscous *v, const tm_nodal_dilatation *averages,
                                   int32_t begin, int32_t end, const double *u_m);
tm_hyper_strain tm_hyper_strain_choose(bool plain);
/* Computes stresses, averages and pressures at u, of all tetrahedra, without terms. */
void tm_hyperelastic_evaluate(const tm_hyperelastic *h, const tm_viscous *v, const tm_nodal_dilatation *averages,
                              bool plain, const double *u_m);
/* Computes the corner forces of all tetrahedra, v->corner_N, without terms. */
void tm_hyperelastic_corners(const tm_hyperelastic *h, const tm_viscous *v, const tm_nodal_dilatation *averages,
                             bool plain, const double *u_m);

/* most [packs.count] := largest |E|^2 of each batch [begin, end), E Green's strain; infinite where a tetrahedron is
 * inside out or a displacement is no number. The same bits in every form. */
typedef void (*tm_hyper_green)(const tm_hyperelastic *h, int32_t begin, int32_t end, const double *u_m, double *most);
tm_hyper_green tm_hyper_green_choose(bool plain);

/* Returns the energy, J, of all active tetrahedra; of one. Without averaged dilatation. */
double tm_hyperelastic_energy(const tm_hyperelastic *h, const double *u_m);
double tm_hyperelastic_tet_energy(const tm_hyperelastic *h, int32_t tet, const double *u_m);
/* Computes d2W/dF2 of one tetrahedron, symmetric 9x9, J. */
void tm_hyperelastic_hessian(const tm_hyperelastic *h, int32_t tet, const double *u_m, double A[81]);
/* A += the change of the dilatation's derivative, under the averaged pressures around the tetrahedron. */
void tm_hyperelastic_add_bend(const tm_hyperelastic *h, const tm_nodal_dilatation *averages, int32_t tet,
                              const double *u_m, double A[81]);
/* Computes the second derivative of its dilatation by F. */
void tm_hyperelastic_dilatation_hessian(const tm_hyperelastic *h, int32_t tet, const double *u_m, double A[81]);

/* Returns an upper bound of the largest eigenvalue of d2W/dF2, Pa, over all F (law_bound.c, with the proof).
 * `averaged`: with the bulk modulus by averaged dilatation, over all its pressures too. */
double tm_law_stiffest_Pa(const tm_material *material, bool averaged);
/* The same over those F, det F > 0, whose Green's strain has a norm of at most `strain`; a domain's pressures are those
 * of tetrahedra within that strain. */
#define TM_STRAIN_MOST 0.45
double tm_law_stiffest_within_Pa(const tm_material *material, bool averaged, double strain);
/* Limits of what the histories of a Prony series store, Pa: |S| of the second Piola stress, and the pressure; what
 * histories within them add to the bound of the tangent is at most more_Pa, the room given (law_bound.c). by_strain: to
 * each bound by strain too. */
typedef struct tm_history_limits {
    double stress_Pa, pressure_Pa[2], more_Pa;
} tm_history_limits;
tm_history_limits tm_law_history_limits(const tm_material *material, bool averaged, double room_Pa, bool by_strain,
                                        double shear, double bulk);
/* Computes the constants of the law for a volume: law_constant, and those that follow from the limit of stretch. */
void tm_law_constants(const tm_material *material, double volume_m3, double constant[TM_LAW_CONSTANTS]);

#endif
