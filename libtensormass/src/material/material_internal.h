/* Internals of material laws: tetrahedra in batches of eight, one per lane, and the passes over them. */
#ifndef TM_MATERIAL_INTERNAL_H
#define TM_MATERIAL_INTERNAL_H

#include "material/effect_range.h"
#include "material/nodal_dilatation.h"
#include "tensormass/rotation.h"
#include "tensormass/tissue.h"

/* Eight consecutive tetrahedra of the mesh, or of a body, removed ones included: active ones have the same index and
 * the same sums in a cut tissue and in a fresh build. */
enum { TM_LANES = TM_ROTATION_LANES };
typedef struct tm_tet_batch {
    int32_t component[4][TM_LANES];            /* 3*vertex of each corner; of a lane without tetrahedron: 0 */
    double shape_1_m[9][TM_LANES];             /* alpha of corners 1, 2, 3; that of corner 0 is minus their sum */
    double mu_J[TM_LANES], lambda_J[TM_LANES]; /* times the volume */
} tm_tet_batch;

/* Volume ratios between which the pressure of nonlinear laws grows. */
#define TM_VOLUME_LEAST 0.5
#define TM_VOLUME_MOST 1.5

/* Constants of the law at large deformation (corotated_kernel.h, corotated_tangent.c). d of Horn's quartic is
 * TM_CORRECTION_MAX size^2, size = (I + TM_CORRECTION_SIZE)/3, where J/size^(3/2) is TM_CORRECTION_FULL or less. It is
 * 0 from TM_CORRECTION_FROM on, and the polynomial of fifth degree between. J/size^(3/2) is 0.41 in a block compressed
 * by 60 % or stretched to twice its length, and 0 in a flat tetrahedron. */
#define TM_CORRECTION_FROM 0.4
#define TM_CORRECTION_FULL (-1.0)
#define TM_CORRECTION_MAX 2.7
#define TM_CORRECTION_SIZE 0.3
/* Fibres: strain up to which they are linear; length below which it is smoothed; I + a.C a (4 at rest) below which a
 * tetrahedron counts as crushed. */
#define TM_FIBRE_FREE 0.5
#define TM_FIBRE_SHORT 0.4
#define TM_FIBRE_CRUSHED 3.0

/* Further constants of batches with fibres: times the volume, but for the fibre. */
typedef struct tm_fibre_batch {
    double dlambda_J[TM_LANES], dmu_J[TM_LANES], beta_J[TM_LANES];
    double fibre[3][TM_LANES];
} tm_fibre_batch;

/* The tetrahedra of a batch: lane l has tet + l, if that is below `end`. */
typedef struct tm_tet_span {
    int32_t tet, end;
} tm_tet_span;

/* Returns the end of a batch's tetrahedra. */
static inline int32_t tm_tet_span_end(tm_tet_span span) {
    return span.tet + TM_LANES < span.end ? span.tet + TM_LANES : span.end;
}

typedef struct tm_tet_batches {
    const tm_mesh *mesh;
    int32_t count, tet_count;
    const tm_tet_span *span; /* [count] ascending; of all tetrahedra, batch p begins with 8p */
    const uint8_t *alive;    /* the tissue's */
    const tm_tet_batch *batch;
    const tm_fibre_batch *fibred;
    const int32_t *fibred_of;    /* [count] into fibred, -1: isotropic; null: all are */
    double begin_1_2, width_1_2; /* |grad u|^2 at which the correction begins; width of the band where it grows */
    const struct tm_single_batches *single; /* the same in single precision, for steps; null: steps are in double */
} tm_tet_batches;

/* force_N += the correction of the listed batches, ascending; energy_J [count] := theirs, unless null. Returns how many
 * had a correction. The forms differ in speed only: every lane computes the same in the same order, so they are
 * bit-identical. */
typedef int32_t (*tm_rotation_kernel)(const tm_tet_batches *packs, const int32_t *list, int32_t count,
                                      const double *u_m, double *force_N, double *energy_J);
/* 0 plain, 1 AVX2, 2 AVX-512; null: not supported by this processor. */
tm_rotation_kernel tm_rotation_form(int form);
tm_rotation_kernel tm_rotation_choose(bool plain);
/* The same without the sums, for threads that share vertices: corner forces of the listed batches, [12*TM_LANES] each,
 * and a bit for each lane that has any. */
typedef void (*tm_corner_force_kernel)(const tm_tet_batches *packs, const int32_t *list, int32_t count,
                                       const double *u_m, double *corner_N, uint8_t *who, double *energy_J);
tm_corner_force_kernel tm_corner_force_choose(bool plain);
/* Sets batches->single. Returns false without memory. */
bool tm_single_rotation_init(tm_tet_batches *batches, tm_pool *pool);

/* Returns the error of grad u in single precision relative to grad u and to tm_tet_batch_spread: five roundings of each
 * term, each at most the longest edge times a gradient of a shape function, and those of the norm. */
double tm_single_rounding_m(const tm_mesh *mesh);

/* The forms of the rotation's kernel in single precision. 0 plain, 1 AVX2; null: not supported by this processor. */
tm_rotation_kernel tm_single_rotation_form(int form);
tm_rotation_kernel tm_single_rotation_choose(bool plain);
tm_corner_force_kernel tm_single_corner_force_choose(bool plain);

/* Returns the energy of the correction, J. */
double tm_rotation_sum_energy(const tm_tet_batches *batches, const double *u_m);
/* Returns the energy of the linear law, computed without tensors. */
double tm_tet_batches_linear_energy(const tm_tet_batches *batches, const double *u_m);

/* Returns a bound of the largest eigenvalue of M_e^-1 K_e over all F, with any masses (or weights) > 0 on the vertices
 * (corotated_bound.c). */
double tm_corotated_eigenvalue_over(const tm_material_field *field, int32_t tet, const double mass_kg[4]);
double tm_corotated_skew_Pa(const tm_material *material);
/* Returns the limit of the tension on averaged dilatation. */
double tm_corotated_tension_max_Pa(const tm_material *material);

/* Histories of relaxing tetrahedra (viscous_kernel.h), stored in addition to the batches. */
enum { TM_VISCOUS_TERMS = 3 };
typedef struct tm_viscous {
    int32_t terms;
    /* The batches hold the long-term law. Times these factors it is a term's law; `more` is the bulk modulus still
     * missing, as a share of bulk_J. whole, whole_more: the same for the instantaneous law, by which moduli are
     * divided. */
    double shear[TM_VISCOUS_TERMS], more[TM_VISCOUS_TERMS], whole, whole_more;
    double volume[TM_VISCOUS_TERMS]; /* shares of bulk moduli */
    const double *relaxed_bulk_Pa;   /* [region_count] by law, averaged bulk modulus of the long-term law; else null */
    const double *relaxed_max_Pa;
    const double *history_Pa; /* [2*region_count] by law, range of averaged pressures that nonlinear laws store */
    /* A step uses h = history + now E, and stores history = history_kept h + old E. */
    double now[TM_VISCOUS_TERMS], history_kept[TM_VISCOUS_TERMS], old[TM_VISCOUS_TERMS];
    bool history_frozen;                /* histories do not change */
    double *corner_N;                   /* [12*TM_LANES*count] corner forces of a batch's lanes */
    double *stress_J;                   /* [9*TM_LANES*count] before pressures, where these are averaged; else null */
    double *history[TM_VISCOUS_TERMS];  /* [TM_LANES*6*count] xx yy zz yz xz xy of a batch's lanes */
    double *bulk_J;                     /* [TM_LANES*count] bulk modulus times volume; 0 where it is averaged */
    double *swelling[TM_VISCOUS_TERMS]; /* [domains] history of averaged dilatation (nodal_dilatation.h), or null */
} tm_viscous;
/* The passes of corotated, relaxing tissue over the batches [begin, end), for the complete law, not the correction.
 * With `averaged` null the first computes corner_N. Otherwise it computes stresses and dilatations; after
 * tm_nodal_dilatation_average over all domains, the second computes corner_N. */
typedef struct tm_viscous_passes {
    /* Advances the histories. Returns how many batches are corotated. */
    int32_t (*strain)(const tm_tet_batches *packs, const tm_viscous *viscous, const tm_nodal_dilatation *averaged,
                      int32_t begin, int32_t end, const double *u_m);
    void (*pressure)(const tm_tet_batches *packs, const tm_viscous *viscous, const tm_nodal_dilatation *averaged,
                     int32_t begin, int32_t end);
} tm_viscous_passes;
tm_viscous_passes tm_viscous_choose(bool plain);

/* The two passes of nodal_dilatation_kernel.h. */
typedef struct tm_nodal_dilatation_passes {
    void (*average)(const tm_tet_batches *packs, const tm_nodal_dilatation *s, const double *u_m);
    void (*press)(const tm_tet_batches *packs, const tm_nodal_dilatation *s, double *force_N);
} tm_nodal_dilatation_passes;
tm_nodal_dilatation_passes tm_nodal_dilatation_choose(bool plain);

/* One lane of one batch, for tangents: rotation, gradient and blend. */
typedef struct tm_corotated_lane {
    double H[9], R[9], trace;                        /* grad u; the rotation and tr S */
    double stress[9], energy_J;                      /* of the corotated law minus the linear one, times the volume */
    double weight, slope, bend;                      /* blend and its derivatives by |H|^2 */
    double mu, lambda, dlambda, dmu, beta, fibre[3]; /* times the volume, but for the fibre */
    bool fibred;
} tm_corotated_lane;
bool tm_rotation_lane(const tm_tet_batches *batches, int32_t tet, const double *u_m, tm_corotated_lane *lane);
/* Reads the constants of the lane only. */
void tm_rotation_lane_law(const tm_tet_batches *batches, int32_t tet, tm_corotated_lane *lane);
/* Computes d2W/dF2 of the correction, symmetric 9x9, J. */
void tm_rotation_hessian(const tm_corotated_lane *lane, double A[81]);
/* The same for the linear law alone. */
void tm_rotation_linear(const tm_corotated_lane *lane, double A[81]);
/* Computes d2 tr S/dF2 of F = I + H = R S. */
void tm_stretch_hessian(const double H[9], const double R[9], double trace, double A[81]);

/* Sums over vertices of the last step: the energy that it generated, without the law's; the work in the next step of a
 * share s of the change of the force, s p + s^2 q. differs: the step did not begin at `seen_m`. */
typedef struct tm_conserve_sums {
    double generated_J, p_J, q_J;
    bool differs;
} tm_conserve_sums;

/* Energy that steps generate, and its removal (world/conserve.c). */
typedef struct tm_conserving {
    struct tm_rotation *rotation;
    const tm_ranges *where; /* vertices whose energy it conserves */
    bool on;
    double fades_1_s;                      /* minimum rate of damping */
    double generated_J, saved_generated_J; /* not yet removed; its value when a call began */
    double rounding_J;                     /* below it generated_J may be rounding; 0 in double */
    double share;                          /* of the change of the force, added in this step */
    /* Of the last step, which began at `seen_m`; not valid: of none. */
    bool valid;
    double last_s, energy_J;
    double *now_before_N, *all_before_N, *seen_m;
    /* [3*vertex_count] the correction (with averaged dilatation: the complete force), the tissue's force, and the added
     * share of its change */
    double *now_N, *all_N, *push_N;
    double *batch_J;       /* [batches] */
    tm_conserve_sums *sum; /* of each block of vertices */
} tm_conserving;

struct tm_rotation {
    tm_pool pool;
    const tm_tissue *tissue;
    tm_tet_batches batches;
    tm_ranges where; /* its vertices */
    tm_nodal_dilatation nodal_dilatation;
    tm_rotation_kernel kernel; /* of steps */
    double threshold;
    double rounding_m; /* bound of the error of grad u in the kernel, relative to grad u and to spread_1_m */
    /* Which batches to check. `reach_m`: distance of components of u from `seen_m` within which no tetrahedron of the
     * batch passes the threshold. */
    double *seen_m;                    /* [3*vertex_count] */
    double *reach_m;                   /* [count] */
    double *spread_1_m;                /* [count] largest growth of grad u per largest displacement component */
    int32_t *list, list_count, *every; /* [count] each; `every` lists all */
    const int32_t *elastic;            /* [elastic_count] those that this stage may list: all, or those that do not
                                          relax by the stage "viscosity" */
    int32_t elastic_count;
    const uint8_t *relaxes; /* [count] 1: the stage "viscosity" computes the batch; null: none */
    double listed_m;        /* the list holds every batch of less reach */
    int64_t listing;        /* number of the list: another one for each change */
    int64_t idle;           /* batches checked without result since `seen_m` */
    bool seen;
    int32_t active;
    bool divided;              /* the last step divided the list among threads */
    double *scratch_N;         /* [3*vertex_count] */
    bool done_by_viscosity;    /* the stage "viscosity" computes the complete force */
    struct tm_relaxing *whole; /* with averaged dilatation: the complete law in passes; else null */
    struct tm_relaxing *terms; /* the stage "viscosity"'s, or null */
    tm_conserving conserving;
};

/* Builds the batches of the laws, without the averaged part: of corotated tissue those where rotation acts. */
bool tm_tet_batches_init(tm_tet_batches *batches, tm_pool *pool, const tm_material_field *field);
/* The same of those tetrahedra where these effects all act, a sum of tm_region_effect. */
bool tm_tet_batches_init_where(tm_tet_batches *batches, tm_pool *pool, const tm_material_field *field, int effects);
/* place[i], in the order of mesh->vertex_tet: index of that corner's first force component, of 12*TM_LANES per batch.
 * Not set for tetrahedra that no batch has. */
void tm_packs_corners(const tm_tet_batches *batches, int32_t *place);
/* Returns the lane of a tetrahedron, 8*batch + lane; -1: no batch has it. */
int64_t tm_tet_slot(const tm_tet_batches *batches, int32_t tet);
double tm_tet_batch_spread(const tm_tet_batches *batches, int32_t p);
/* Returns how many of `count` items belong to the parts before this one. */
static inline int32_t tm_tet_batches_before(int32_t count, int32_t part, int32_t parts) {
    return (int32_t)((int64_t)count * part / parts);
}
/* Sets r->list to the batches that may have a correction at u, ascending. If tm_tet_batches_wait returns true, first
 * check all batches and vertices, in shares (_mark_seen), then call _seen. Then pass the largest travel of all
 * vertices since then (_increment) to _list. */
bool tm_tet_batches_wait(const tm_rotation *r);
void tm_tet_batches_mark_seen(tm_rotation *r, const double *u_m, int32_t part, int32_t parts);
void tm_tet_batches_seen(tm_rotation *r);
double tm_tet_batches_increment(const tm_rotation *r, const double *u_m, int32_t part, int32_t parts);
void tm_tet_batches_list(tm_rotation *r, double way_m);
#endif
