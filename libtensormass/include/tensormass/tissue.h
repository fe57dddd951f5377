/* Tissue: an assembled mesh with materials. Stiffness tensors of vertices and edges, lumped masses, surface. Constant
 * unless a scene cuts. */
#ifndef TENSORMASS_TISSUE_H
#define TENSORMASS_TISSUE_H

#include "material.h"
#include "mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Precision of the stored edge tensors; with rotation also that of its correction in a step, and with a nonlinear law
 * that of its stresses alone (material/single_batches.h), while settling, energies and tangents stay double. TM_SINGLE
 * is for constrained tissue (tm_world_check_constrained). Rounded tensors have no exact rigid-body modes: undamped, a
 * free body grows unstable, by a factor e in ten to a hundred thousand steps. */
typedef enum tm_precision { TM_DOUBLE = 0, TM_SINGLE = 1 } tm_precision;

/* Form of the force loop. All SIMD forms agree with TM_FORCE_PLAIN to rounding; only the plain form gives the same bits
 * with all compilers and processors. */
typedef enum tm_force_form { TM_FORCE_BEST = 0, TM_FORCE_PLAIN = 1 } tm_force_form;

/* Effects that may act in some bodies of a mesh only (docs/bodies.md). */
typedef enum tm_region_effect {
    TM_REGION_ROTATION = 1,
    TM_REGION_SMOOTHING = 2,
    TM_REGION_VISCOSITY = 4
} tm_region_effect;

typedef struct tm_tissue_def {
    uint32_t cookie, size;
    const tm_mesh *mesh; /* must outlive the tissue */
    int32_t material_count;
    const tm_material *material;    /* [material_count], copied */
    const int32_t *region_material; /* [mesh->region_count] material of each region, or null: region i has material i */
    const double *fibre;            /* [3*tet_count] unit vectors, copied; null if every material is isotropic */
    tm_precision precision;
    tm_force_form form;
    bool cuttable;                                    /* allocate what cutting needs; false: tm_cut_* refuse */
    const double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] of what is attached without being part of the
                                                         tissue (the condensed part of a hybrid); copied; null: none */
    const uint8_t
        *alive; /* [tet_count] 0: build without this tetrahedron; null: all active. Tests use it for fresh builds */
    /* Strain smoothing: far less locking towards Poisson's ratio 0.5, and a more accurate element
     * (docs/strain-smoothing.md). The volume change is averaged over the tetrahedra around each vertex;
     * `smoothed_shear_share` (0 to 1) of the shear is averaged over those around each edge. Four times the blocks, a
     * longer step. Double only; not with a hybrid. */
    bool strain_smoothing;
    /* [0.4] Higher is better in bending (nu 0.49, 4 cells across: error 14 %, at 1 6 %), lower is better in compression
     * on fine meshes (10,368 tetrahedra: error 6.2 %, at 1 9.4 %). With rotation 0 only. */
    double smoothed_shear_share;
    /* [tet_count] 1: not active here, but present in the condensed part of a hybrid. Cutting keeps the common surface
     * manifold and never removes it. Copied; null: none. */
    const uint8_t *condensed;
    /* 0; > 0: threshold of the stage "rotation" (tensormass/rotation.h). Critical steps then hold for corotated
     * tetrahedra too. */
    double rotation;
    /* Selective mass scaling. 0; > 0: masses are increased where needed, until this step is guaranteed, after any cut
     * too. Only inertia changes: weight, damping and equilibrium use the physical mass. Total added mass above
     * `scaled_share`: TM_ERR_LIMIT. Not with a condensed part. */
    double scaled_step_s;
    double scaled_share; /* [0.2] of the physical mass */
    /* [region_count] sums of tm_region_effect: where rotation, strain smoothing and viscosity act, if the tissue or its
     * world has them. Copied; null: in all regions. Regions that differ here share no vertex, else TM_ERR_ARGUMENT. An
     * effect stores and computes nothing for regions without it. */
    const uint8_t *region_effects;
} tm_tissue_def;

typedef struct tm_tissue tm_tissue;

TM_API tm_tissue_def tm_tissue_def_default(void);
TM_API tm_status tm_tissue_create(const tm_tissue_def *def, tm_tissue **tissue, tm_error *error);
TM_API void tm_tissue_destroy(tm_tissue *tissue);

/* Read-only views. Pointers stay valid for the tissue's life; contents change only by cutting. */
TM_API const tm_mesh *tm_tissue_mesh(const tm_tissue *tissue);
TM_API const double *tm_tissue_mass_kg(const tm_tissue *tissue); /* [vertex_count], 0: in no active tetrahedron */
/* Returns the mass without what mass scaling adds: gravity acts on it. */
TM_API const double *tm_tissue_physical_mass_kg(const tm_tissue *tissue);
TM_API const double *
tm_tissue_damping_kg_s(const tm_tissue *tissue);                /* [vertex_count] gamma = sum of d * lumped mass */
TM_API const uint8_t *tm_tissue_alive(const tm_tissue *tissue); /* [tet_count] */
TM_API const tm_material *tm_tissue_tet_material(const tm_tissue *tissue, int32_t tet);
TM_API const double *tm_tissue_tet_fibre(const tm_tissue *tissue, int32_t tet); /* [3] or null */
TM_API int32_t tm_tissue_alive_count(const tm_tissue *tissue);
TM_API int64_t tm_tissue_bytes(const tm_tissue *tissue);

/* Return tensors as doubles in any storage precision. K[9] row-major, N/m: K_kk, and K_kl with k<l (K_lk is its
 * transpose). */
TM_API void tm_tissue_vertex_tensor(const tm_tissue *tissue, int32_t vertex, double K[9]);
TM_API void tm_tissue_edge_tensor(const tm_tissue *tissue, int32_t edge, double K[9]);

/* Pairs of vertices with a block: the mesh's edges, and more with strain smoothing. Ascending, constant for the
 * tissue's life: removed pairs have zeros. */
typedef struct tm_pair_view {
    int32_t count;
    const int32_t *begin; /* [vertex_count+1] first pair whose lower vertex it is */
    const int32_t *ends;  /* [2*count] k<l */
} tm_pair_view;
TM_API tm_pair_view tm_tissue_pairs(const tm_tissue *tissue);
TM_API void tm_tissue_pair_tensor(const tm_tissue *tissue, int32_t pair, double K[9]); /* K_kl */
/* Returns the share of the shear that is averaged over edges; below 0: no strain smoothing. */
TM_API double tm_tissue_smoothed_shear_share(const tm_tissue *tissue);

/* Returns `region_effects` of the definition, [region_count]; null: all effects act in all regions. */
TM_API const uint8_t *tm_tissue_region_effects(const tm_tissue *tissue);

/* Surface of the active tetrahedra. Its order is arbitrary after cuts; `face` (4*tet + local vertex) is the persistent
 * id of each triangle. */
typedef struct tm_surface_view {
    int32_t count;
    const int32_t *triangle; /* [3*count] vertices, normal outward */
    const int32_t *face;     /* [count] */
    int32_t revision;        /* increases by one with every change */
} tm_surface_view;
TM_API tm_surface_view tm_tissue_surface(const tm_tissue *tissue);

/* --- removal of tetrahedra ---
 * Exact: after any sequence of removals, tensors, masses, surface and forces equal a fresh build of the rest, bit for
 * bit. */

/* Removes the listed active tetrahedra (removed ones are skipped), then further ones until the mesh is conformal and
 * manifold: fans attached by an edge or a vertex only (the largest fan stays), and closed fans around a vertex (cut
 * open). Requires def.cuttable. A world updates at its next tm_world_step. No allocation. Returns the total number
 * removed; `removed` (may be null) receives their indices. */
TM_API int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed,
                             int32_t removed_max);

/* Computes force_N[3*vertex_count] := -K u. The most expensive loop. No allocation. */
TM_API void tm_tissue_force(const tm_tissue *tissue, const double *u_m, double *force_N);
/* Returns the stored energy u.K u / 2, J. */
TM_API double tm_tissue_energy(const tm_tissue *tissue, const double *u_m);

/* Deformation of the active tetrahedra, F = 1 + grad u. */
typedef struct tm_deformation {
    double min_det;          /* minimum det F; 0 and below: inverted */
    int32_t min_det_tet;     /* -1: none is active */
    int32_t inverted;        /* tetrahedra with det F <= 0 */
    double nonlinear_strain; /* maximum |grad u^T grad u| / 2: the strain that the linear law neglects */
    int32_t nonlinear_tet;
    double nonlinear_share; /* share of the volume where it exceeds TM_LINEAR_STRAIN_MAX; beside materials with a
                               nonlinear law, or bodies with rotation: in linear ones */
} tm_deformation;
/* Limit of tissue without "rotation": it corresponds to a rotation by 22 degrees, or a stretch by 45 %. */
#define TM_LINEAR_STRAIN_MAX 0.1
/* Measures the deformation in one pass over the tetrahedra. u_m [3*vertex_count], m. No allocation. */
TM_API tm_deformation tm_tissue_deformation(const tm_tissue *tissue, const double *u_m);
/* Returns whether the deformation is doubtful: inverted tetrahedra, or, without `rotation`, more than 1 % of the volume
 * above TM_LINEAR_STRAIN_MAX. `sentence` says what is wrong and what to do; it is empty on false. */
TM_API bool tm_tissue_check_deformation(const tm_tissue *tissue, const tm_deformation *deformation,
                                        char sentence[TM_ERROR_MESSAGE_MAX]);

/* Returns a guaranteed stable step, s: 2/sqrt of an upper bound of the largest eigenvalue of M^-1 K, from single
 * tetrahedra. `*tet` is the one that sets it. Valid with any supports and any damping >= 0 of central differences,
 * which does not lower it.
 *
 * Cuttable tissue, or extra masses (to which something else is attached): the minimum of tm_critical_step_element over
 * the active tetrahedra, which holds after any cut. With mass scaling it is also at least the requested step. Otherwise
 * each vertex shares its mass among its tetrahedra by demand. That step is never shorter, and much longer on meshes
 * with slivers (docs/time-stepping.md). It allocates; without memory the result is the former. Some microseconds per
 * tetrahedron. */
TM_API double tm_critical_step_guaranteed(const tm_tissue *tissue, int32_t *tet);
/* Returns 2/sqrt(largest eigenvalue of M_e^-1 K_e) of one tetrahedron (Irons), s: its critical step in isolation. */
TM_API double tm_critical_step_element(const tm_tissue *tissue, int32_t tet);
/* Estimates 2/omega_max of the assembled system by power iteration, until the residual bound is below `tolerance`
 * (relative). `fixed` [3*vertex_count] marks constrained components, or null. For reports only: the estimate converges
 * from the unstable side. Allocates. */
TM_API tm_status tm_critical_step_estimate(const tm_tissue *tissue, const uint8_t *fixed, double tolerance,
                                           int32_t max_iterations, double *step_s, tm_error *error);

/* --- mass scaling --- */

/* Mass scaling of the active tissue at present. */
typedef struct tm_mass_scaling {
    double step_s; /* step that it guarantees; 0: no mass scaling */
    double physical_kg, added_kg;
    int32_t vertices;          /* with added mass */
    int32_t max_factor_vertex; /* vertex with the largest factor; -1: none */
    double max_factor;         /* relative to the physical mass */
} tm_mass_scaling;
/* Reports it. Returns false if the tissue was made without `scaled_step_s`. */
TM_API bool tm_tissue_mass_scaling(const tm_tissue *tissue, tm_mass_scaling *out);
/* Estimates the effect on the lowest frequencies, Hz: Rayleigh quotients of the shapes under the tissue's own weight
 * along x, y and z, with the physical and the scaled mass. `fixed` [3*vertex_count] marks constrained components; if a
 * connected component has rigid-body modes: TM_ERR_CONVERGENCE. Allocates; costs some hundred force passes. */
TM_API tm_status tm_mass_scaling_frequencies(const tm_tissue *tissue, const uint8_t *fixed, double own_Hz[3],
                                             double scaled_Hz[3], tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
