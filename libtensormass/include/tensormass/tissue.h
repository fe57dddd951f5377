/* Tissue: a mesh with materials, assembled. Stiffness tensors on vertices and edges, lumped masses, the surface.
 * Constant unless a scene cuts. */
#ifndef TENSORMASS_TISSUE_H
#define TENSORMASS_TISSUE_H

#include "material.h"
#include "mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of the stored edge tensors only. TM_SINGLE is for tissue that is held (tm_world_check_constrained): rounded tensors
 * do not quite let a body turn as a whole, and undamped a free one is driven by that, e-fold in ten to a hundred
 * thousand steps. */
typedef enum tm_precision { TM_DOUBLE = 0, TM_SINGLE = 1 } tm_precision;

/* Which form of the force loop runs. All SIMD forms agree with TM_FORCE_PLAIN to rounding; only the plain form's
 * bits are promised across compilers and processors. */
typedef enum tm_force_form { TM_FORCE_BEST = 0, TM_FORCE_PLAIN = 1 } tm_force_form;

typedef struct tm_tissue_def {
    uint32_t cookie, size;
    const tm_mesh *mesh; /* must outlive the tissue */
    int32_t material_count;
    const tm_material *material;    /* [material_count], copied */
    const int32_t *region_material; /* [mesh->region_count] material of each region, or null: region i has material i */
    const double *fibre;            /* [3*tet_count] unit vectors, copied; null if every material is isotropic */
    tm_precision precision;
    tm_force_form form;
    bool cuttable; /* take the memory that cutting needs now; false: tm_cut_* refuse */
    const double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] of what hangs on the tissue and is not in it
                                                         (the condensed part of a hybrid); copied; null: none */
    const uint8_t
        *alive; /* [tet_count] 0: build without this tetrahedron; null: all alive. "The fresh build" of tests */
    /* Far less locking towards Poisson's ratio 0.5, and a better element altogether (docs/strain-smoothing.md): the
     * change of volume is averaged over the tetrahedra around each vertex, and `smoothed_shear_share` of the shear,
     * from 0 to 1, over those around each edge. Four times the blocks, a longer step. Double only; not under a hybrid.
     */
    bool strain_smoothing;
    double
        smoothed_shear_share; /* [0.4] more bends better (nu 0.49, 4 cells across: 14 % too little, at 1 6 %), less is
                         exacter where tissue is pressed on fine meshes (10,368 tetrahedra: 6.2 % off, at 1
                         9.4 %); with rotation 0, and nothing else */
    const uint8_t *condensed; /* [tet_count] 1: not alive here, and there all the same (the condensed part of a hybrid):
                                 cutting keeps the surface of both together a manifold, and never removes it; copied;
                                 null: none */
    double rotation;          /* 0; > 0: the stage "rotation" will turn its tetrahedra beyond this threshold
                                 (tensormass/rotation.h): critical steps hold for that too */
    /* Selective mass scaling. 0; > 0: vertices are made heavier, where they must be, until a step of so many seconds is
     * guaranteed, after any cut too. Inertia alone: weight, damping and rest are those of the tissue's own mass. More
     * than `scaled_share` of that added in all: TM_ERR_LIMIT. Not beside a condensed part. */
    double scaled_step_s;
    double scaled_share; /* [0.2] */
} tm_tissue_def;

typedef struct tm_tissue tm_tissue;

TM_API tm_tissue_def tm_tissue_def_default(void);
TM_API tm_status tm_tissue_create(const tm_tissue_def *def, tm_tissue **tissue, tm_error *error);
TM_API void tm_tissue_destroy(tm_tissue *tissue);

/* Read-only views; pointers stay valid for the tissue's life, contents change only by cutting. */
TM_API const tm_mesh *tm_tissue_mesh(const tm_tissue *tissue);
TM_API const double *tm_tissue_mass_kg(const tm_tissue *tissue); /* [vertex_count], 0: in no living tetrahedron */
/* The same without what mass scaling has added: what gravity pulls. */
TM_API const double *tm_tissue_physical_mass_kg(const tm_tissue *tissue);
TM_API const double *
tm_tissue_damping_kg_s(const tm_tissue *tissue);                /* [vertex_count] gamma = sum of d * lumped mass */
TM_API const uint8_t *tm_tissue_alive(const tm_tissue *tissue); /* [tet_count] */
TM_API const tm_material *tm_tissue_tet_material(const tm_tissue *tissue, int32_t tet);
TM_API const double *tm_tissue_tet_fibre(const tm_tissue *tissue, int32_t tet); /* [3] or null */
TM_API int32_t tm_tissue_alive_count(const tm_tissue *tissue);
TM_API int64_t tm_tissue_bytes(const tm_tissue *tissue);

/* Tensors as doubles whatever they are stored in. K[9] row-major, N/m: K_kk, and K_kl with k<l (K_lk is its transpose).
 */
TM_API void tm_tissue_vertex_tensor(const tm_tissue *tissue, int32_t vertex, double K[9]);
TM_API void tm_tissue_edge_tensor(const tm_tissue *tissue, int32_t edge, double K[9]);

/* The pairs of vertices that a tissue has blocks for: the mesh's edges, and more with `volume`. Ascending; constant for
 * life, as dead pairs have zeros. */
typedef struct tm_pair_view {
    int32_t count;
    const int32_t *begin; /* [vertex_count+1] the first pair whose lower vertex it is */
    const int32_t *ends;  /* [2*count] k<l */
} tm_pair_view;
TM_API tm_pair_view tm_tissue_pairs(const tm_tissue *tissue);
TM_API void tm_tissue_pair_tensor(const tm_tissue *tissue, int32_t pair, double K[9]); /* K_kl */
/* The share of the shear that is averaged over edges; below 0: tissue without `volume`. */
TM_API double tm_tissue_smoothed_shear_share(const tm_tissue *tissue);

/* The living surface. Slots are unordered after cuts; `face` (4*tet + local vertex) is each triangle's persistent id.
 */
typedef struct tm_surface_view {
    int32_t count;
    const int32_t *triangle; /* [3*count] vertices, normal outward */
    const int32_t *face;     /* [count] */
    int32_t revision;        /* grows by one with every change */
} tm_surface_view;
TM_API tm_surface_view tm_tissue_surface(const tm_tissue *tissue);

/* --- removal of tetrahedra. Exact: after any sequence, tensors, masses, surface and forces equal a fresh build of what
 * is left, bit for bit. --- */

/* Removes the listed tetrahedra (living ones; dead ones are skipped) and then whatever must go to leave the mesh
 * conformal and manifold: fans that hang by an edge or a vertex (the largest fan stays), rings about a vertex (cut
 * open). Needs def.cuttable. A world notices at its next tm_world_step. No allocation. Returns how many were removed in
 * all. `removed` (may be null) receives their indices. */
TM_API int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed,
                             int32_t removed_max);

/* force_N[3*vertex_count] := -K u. The hot loop. No allocation. */
TM_API void tm_tissue_force(const tm_tissue *tissue, const double *u_m, double *force_N);
/* Stored energy u.K u / 2, J. */
TM_API double tm_tissue_energy(const tm_tissue *tissue, const double *u_m);

/* How far living tetrahedra are deformed, F = 1 + grad u. */
typedef struct tm_deformation {
    double min_det;          /* the smallest det F; 0 and below: turned inside out */
    int32_t min_det_tet;     /* -1: none is alive */
    int32_t inverted;        /* tetrahedra with det F <= 0 */
    double nonlinear_strain; /* the largest |grad u^T grad u| / 2: the strain that the linear law leaves out */
    int32_t nonlinear_tet;
    double nonlinear_share; /* of the volume where that is above TM_LINEAR_STRAIN_MAX */
} tm_deformation;
/* Beyond it tissue without "rotation" is far outside its range: a turn of 22 degrees, or a stretch of 45 %. */
#define TM_LINEAR_STRAIN_MAX 0.1
/* One pass over the tetrahedra. u_m [3*vertex_count], m. No allocation. */
TM_API tm_deformation tm_tissue_deformation(const tm_tissue *tissue, const double *u_m);
/* What is doubtful about it, and what to do, as a sentence: tetrahedra inside out, or, of tissue without `rotation`,
 * more than 1 % of the volume above TM_LINEAR_STRAIN_MAX. False, and an empty sentence: nothing is. */
TM_API bool tm_tissue_check_deformation(const tm_tissue *tissue, const tm_deformation *deformation,
                                        char sentence[TM_ERROR_MESSAGE_MAX]);

/* Guaranteed to be stable, s: 2/sqrt of a bound of the largest eigenvalue of M^-1 K, from single tetrahedra. `*tet`
 * names the one that sets it. Valid with any damping >= 0 of central differences (which do not lower it) and any
 * supports. Cuttable, or with extra masses (on which something else lives): the least of tm_critical_step_element over
 * the living tetrahedra, which holds after any cut; with mass scaling that too, and at least the step asked for.
 * Otherwise the masses of vertices are shared among their tetrahedra
 * by demand, which is never shorter, and much longer where the mesh has slivers (docs/time-stepping.md); takes work
 * space, and without memory for it is the former. Some microseconds a tetrahedron. */
TM_API double tm_critical_step_guaranteed(const tm_tissue *tissue, int32_t *tet);
/* 2/sqrt(largest eigenvalue of M_e^-1 K_e) of one tetrahedron (Irons): its critical step should it be left alone, s. */
TM_API double tm_critical_step_element(const tm_tissue *tissue, int32_t tet);
/* Sharp: 2/omega_max of the assembled system by power iteration, run until the residual bound is below `tolerance`
 * (relative). `fixed` [3*vertex_count] marks constrained components, or null. Reported only; comes from the unsafe
 * side. Allocates. */
TM_API tm_status tm_critical_step_estimate(const tm_tissue *tissue, const uint8_t *fixed, double tolerance,
                                           int32_t max_iterations, double *step_s, tm_error *error);

/* --- mass scaling --- */

/* Of the living tissue, as it is now. */
typedef struct tm_mass_scaling {
    double step_s; /* guaranteed by it; 0: no mass scaling */
    double physical_kg, added_kg;
    int32_t vertices;          /* that were made heavier */
    int32_t max_factor_vertex; /* by the largest factor; -1: none */
    double max_factor;         /* of its own mass */
} tm_mass_scaling;
/* False: the tissue was not made with `scaled_step_s`. */
TM_API bool tm_tissue_mass_scaling(const tm_tissue *tissue, tm_mass_scaling *out);
/* What it does to the lowest frequencies, Hz: Rayleigh's quotients of the shapes in which the tissue gives way to its
 * own weight along x, y and z, with its own mass and with what was added. `fixed` [3*vertex_count] marks constrained
 * components; where they do not hold every piece, TM_ERR_CONVERGENCE. Allocates; some hundred force passes. */
TM_API tm_status tm_mass_scaling_frequencies(const tm_tissue *tissue, const uint8_t *fixed, double own_Hz[3],
                                             double scaled_Hz[3], tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
