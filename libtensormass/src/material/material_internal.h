/* What the room `material` gives: tetrahedra in packs of eight, one a lane, and what is computed of them. */
#ifndef TM_MATERIAL_INTERNAL_H
#define TM_MATERIAL_INTERNAL_H

#include "material/nodal_dilatation.h"
#include "tensormass/rotation.h"
#include "tensormass/tissue.h"

/* Tetrahedra 8p to 8p+7 of the mesh, dead ones among them: whoever lives has the same place and the same sums in a cut
 * tissue and in a fresh build. */
enum { TM_LANES = TM_ROTATION_LANES };
typedef struct tm_tet_batch {
    int32_t component[4][TM_LANES];            /* 3*vertex of each corner; of a lane without tetrahedron: 0 */
    double shape_1_m[9][TM_LANES];             /* alpha of corners 1, 2, 3; that of corner 0 is minus their sum */
    double mu_J[TM_LANES], lambda_J[TM_LANES]; /* times the volume */
} tm_tet_batch;

/* The law far from rest (corotated_kernel.h, corotated_tangent.c). d of Horn's quartic is TM_CORRECTION_MAX size^2,
 * size = (I + TM_CORRECTION_SIZE)/3, where J/size^(3/2) is TM_CORRECTION_FULL or less, 0 from TM_CORRECTION_FROM on,
 * the polynomial of fifth degree between. A block pressed by 60 % or stretched to twice its length has 0.41; a
 * tetrahedron that is flat, 0. */
#define TM_CORRECTION_FROM 0.4
#define TM_CORRECTION_FULL (-1.0)
#define TM_CORRECTION_MAX 2.7
#define TM_CORRECTION_SIZE 0.3
/* Fibres: strains up to which they are linear; the shortest length that is told from none; by which I + a.C a (4 at
 * rest) a tetrahedron is crushed. */
#define TM_FIBRE_FREE 0.5
#define TM_FIBRE_SHORT 0.4
#define TM_FIBRE_CRUSHED 3.0

/* The rest of the law, of packs with fibres: times the volume but for the fibre. */
typedef struct tm_fibre_batch {
    double dlambda_J[TM_LANES], dmu_J[TM_LANES], beta_J[TM_LANES];
    double fibre[3][TM_LANES];
} tm_fibre_batch;

typedef struct tm_tet_batches {
    const tm_mesh *mesh;
    int32_t count, tet_count;
    const uint8_t *alive; /* the tissue's */
    const tm_tet_batch *batch;
    const tm_fibre_batch *fibred;
    const int32_t *fibred_of;    /* [count] into fibred, -1: isotropic; null: all are */
    double begin_1_2, width_1_2; /* |grad u|^2 at which the correction begins, and up to where it grows */
} tm_tet_batches;

/* force_N += the correction of the listed packs, ascending; energy_J [count] := theirs, unless null. Returns how many
 * of them had anything to add. The forms differ in speed alone: every lane computes the same in the same order, so that
 * the bits are the same too. */
typedef int32_t (*tm_rotation_kernel)(const tm_tet_batches *packs, const int32_t *list, int32_t count,
                                      const double *u_m, double *force_N, double *energy_J);
/* 0 plain, 1 AVX2, 2 AVX-512; null: this processor has it not. */
tm_rotation_kernel tm_rotation_form(int form);
tm_rotation_kernel tm_rotation_choose(bool plain);
/* The same in two steps, for who shares the vertices with others: what the corners of the listed packs are pulled with,
 * [12*TM_LANES] each, and a bit for each lane that is; then what of that is on the vertices [begin, end), in the list's
 * order (tm_corner_forces_add). */
typedef void (*tm_corner_force_kernel)(const tm_tet_batches *packs, const int32_t *list, int32_t count,
                                       const double *u_m, double *corner_N, uint8_t *who, double *energy_J);
tm_corner_force_kernel tm_corner_force_choose(bool plain);
/* The same correction as an energy, J. */
double tm_rotation_sum_energy(const tm_tet_batches *batches, const double *u_m);
/* That of the linear law, computed without tensors. */
double tm_tet_batches_linear_energy(const tm_tet_batches *batches, const double *u_m);

/* Bound of the largest eigenvalue of M_e^-1 K_e over all F, with any masses (or weights) > 0 on the vertices
 * (corotated_bound.c). */
double tm_corotated_eigenvalue_over(const tm_material_field *field, int32_t tet, const double mass_kg[4]);
double tm_corotated_skew_Pa(const tm_material *material);
/* Where changes of volume are averaged, tension on them grows no further. */
double tm_corotated_tension_max_Pa(const tm_material *material);

/* Histories of tetrahedra that relax (viscous_kernel.h), beside the packs. */
enum { TM_VISCOUS_TERMS = 3 };
typedef struct tm_viscous {
    int32_t terms;
    /* By what the packs' law, which is what the series leaves, is multiplied to be a term's, and the bulk modulus that
     * is missing then, as a share of bulk_J; the same for the sudden law, by which moduli are shared out. */
    double shear[TM_VISCOUS_TERMS], more[TM_VISCOUS_TERMS], whole, whole_more;
    double volume[TM_VISCOUS_TERMS]; /* shares of bulk moduli */
    const double *relaxed_bulk_Pa;   /* [region_count] by law, of what is averaged and left; else null */
    const double *relaxed_max_Pa;
    /* The history h = memory + now E becomes memory = keep h + old E. */
    double now[TM_VISCOUS_TERMS], history_kept[TM_VISCOUS_TERMS], old[TM_VISCOUS_TERMS];
    bool history_frozen;                /* histories do not go on */
    double *corner_N;                   /* [12*TM_LANES*count] what each corner of a pack's lanes is pulled with */
    double *stress_J;                   /* [9*TM_LANES*count] before pressures, where these are averaged; else null */
    double *history[TM_VISCOUS_TERMS];  /* [TM_LANES*6*count] xx yy zz yz xz xy of a pack's lanes */
    double *bulk_J;                     /* [TM_LANES*count] bulk modulus times volume; 0 where it is averaged */
    double *swelling[TM_VISCOUS_TERMS]; /* [domains] as memory, of averaged changes of volume (nodal_dilatation.h), or
                                           null */
} tm_viscous;
/* The passes of tissue that turns and relaxes over the packs [begin, end), of the whole law and not of what turning
 * adds to it. With `averaged` null the first leaves corner_N. Else it leaves stresses and what swells, and the second,
 * when tm_nodal_dilatation_average has gone over all domains, corner_N. */
typedef struct tm_viscous_passes {
    /* Histories go on to the next step. Returns how many packs have turned. */
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

/* One lane of one pack, for tangents: rotation, gradient and blend. */
typedef struct tm_corotated_lane {
    double H[9], R[9], trace;                        /* grad u; the rotation and tr S */
    double stress[9], energy_J;                      /* of the turned law less the linear one, times the volume */
    double weight, slope, bend;                      /* blend and its derivatives by |H|^2 */
    double mu, lambda, dlambda, dmu, beta, fibre[3]; /* times the volume, but for the fibre */
    bool fibred;
} tm_corotated_lane;
bool tm_rotation_lane(const tm_tet_batches *batches, int32_t tet, const double *u_m, tm_corotated_lane *lane);
/* Its constants alone. */
void tm_rotation_lane_law(const tm_tet_batches *batches, int32_t tet, tm_corotated_lane *lane);
/* d2W/dF2 of the correction, symmetric 9x9, J. */
void tm_rotation_hessian(const tm_corotated_lane *lane, double A[81]);
/* The same of the linear law alone. */
void tm_rotation_linear(const tm_corotated_lane *lane, double A[81]);
/* d2 tr S/dF2 of F = I + H = R S. */
void tm_stretch_hessian(const double H[9], const double R[9], double trace, double A[81]);

/* What the step makes of energy, and what takes it back (world/conserve.c). */
typedef struct tm_conserving {
    struct tm_rotation *rotation;
    bool on;
    double fades_1_s;                      /* the least rate of damping */
    double generated_J, saved_generated_J; /* not taken back yet; that when a call began */
    double share;                          /* of the change of the force, that this step has added */
    /* Of the last step, which began where `seen_m` is; unless valid, of none. */
    bool valid;
    double last_s, energy_J;
    double *now_before_N, *all_before_N, *seen_m;
    /* [3*vertex_count] the correction (of averaged volume: all), the tissue's force, and share of its change */
    double *now_N, *all_N, *push_N;
    double *batch_J; /* [packs] */
} tm_conserving;

struct tm_rotation {
    tm_pool pool;
    const tm_tissue *tissue;
    tm_tet_batches batches;
    tm_nodal_dilatation nodal_dilatation;
    tm_rotation_kernel kernel;
    double threshold;
    /* Which packs have to be looked at. `reach_m`: how far components of u may be from `seen_m` before anything of the
     * pack can pass the threshold. */
    double *seen_m;     /* [3*vertex_count] */
    double *reach_m;    /* [count] */
    double *spread_1_m; /* [count] by how much grad u grows, at most, with the largest component of a displacement */
    int32_t *list, list_count, *every; /* [count] each; `every` names all */
    double listed_m;                   /* the list holds every pack of less reach */
    int64_t idle;                      /* packs looked at in vain since `seen_m` */
    bool seen;
    int32_t active;
    double *scratch_N;         /* [3*vertex_count] */
    bool done_by_viscosity;    /* whose stage does all of it */
    struct tm_relaxing *whole; /* where changes of volume are averaged: the whole law in passes; else null */
    tm_conserving conserving;
    int32_t *reached; /* [2*count] divided among threads: first and last vertex of a pack; else null */
};

/* Laws without what is averaged around vertices. */
bool tm_tet_batches_init(tm_tet_batches *batches, tm_pool *pool, const tm_material_field *field);
/* place[i], in the order of mesh->vertex_tet: the first component of that corner's force among 12*TM_LANES a pack. */
void tm_packs_corners(const tm_mesh *mesh, int32_t *place);
double tm_tet_batch_spread(const tm_mesh *mesh, int32_t p);
/* Of `count` things, those of the parts before this one. */
static inline int32_t tm_tet_batches_before(int32_t count, int32_t part, int32_t parts) {
    return (int32_t)((int64_t)count * part / parts);
}
/* r->list becomes the packs that may have something to add at u, ascending. First, if tm_tet_batches_wait says so,
 * all packs and vertices are looked at, in shares, and that is told; then it takes the largest of all vertices' ways
 * since. */
bool tm_tet_batches_wait(const tm_rotation *r);
void tm_tet_batches_mark_seen(tm_rotation *r, const double *u_m, int32_t part, int32_t parts);
void tm_tet_batches_seen(tm_rotation *r);
double tm_tet_batches_increment(const tm_rotation *r, const double *u_m, int32_t part, int32_t parts);
void tm_tet_batches_list(tm_rotation *r, double way_m);
void tm_corner_forces_add(const tm_tet_batches *batches, const int32_t *list, int32_t count, const double *corner_N,
                          const uint8_t *who, int32_t begin, int32_t end, double *force_N);
#endif
