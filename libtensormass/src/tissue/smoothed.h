/* Tissue that does not lock (effect "volume"): strain averaged over the tetrahedra around a vertex for the change of
 * volume, around an edge for a share of the shear (docs/physics.md). Still tensor/mass: blocks on vertices and on pairs
 * of vertices, only of more pairs than the mesh has edges. */
#ifndef TM_SMOOTHED_H
#define TM_SMOOTHED_H

#include "tissue/tissue_internal.h"

/* What is averaged: for each vertex, or edge, and each law around it the living tetrahedra that have it. Numbered by
 * owner, then by the law's first tetrahedron. */
typedef struct tm_domains {
    bool of_edges;
    int32_t count, member_count;
    int32_t *begin;     /* [owners+1] first domain of each vertex or edge */
    int32_t *law;       /* [count] the first region that has it */
    int32_t *member_at; /* [count+1] */
    int32_t *member;    /* [member_count] vertices, ascending within a domain */
    uint8_t *lives;     /* [member_count] 1: a living tetrahedron of the domain has it */
    double *gradient;   /* [3*member_count] of the averaged strain by the member's displacement, 1/m */
    double *volume_m3;  /* [count] share of the living tetrahedra's */
    double *law_Pa;     /* [36*count] averaged elasticity (Voigt) where fibres may differ; else null */
    int32_t *held_at;   /* [vertex_count+1] */
    int32_t *held_by;   /* [member_count] domains that have a vertex, ascending */
    int32_t *held_as;   /* [member_count] as which member */
} tm_domains;

typedef struct tm_smoothed {
    double shear;      /* share of the shear that is averaged over edges */
    int32_t *law;      /* [region_count] the first region with the same elastic constants */
    double *bulk_Pa;   /* [region_count] what is averaged over vertices */
    tm_material *rest; /* [region_count] the law without it */
    int32_t pair_count;
    int32_t *pair; /* [2*pair_count] k<l, ascending */
    /* Cuttable: kept for life. Otherwise made for building and for the critical step, and given back. */
    tm_domains vertex, edge;
    /* of one row, and which rows a cut touched */
    int32_t *place;  /* [vertex_count] */
    double *block;   /* [9*most pairs of a row] */
    uint8_t *filled; /* [most pairs of a row] */
    int32_t row_count, *row;
    uint8_t *row_waits; /* [vertex_count] */
} tm_smoothed;

/* Bulk modulus whose subtraction leaves the law semidefinite, the largest there is: 1 / (m.C^-1 m), m the unit tensor;
 * lambda + 2/3 mu of isotropic tissue. */
double tm_smoothed_bulk_Pa(const tm_material *material);

/* Fills tissue->smoothed from the definition, from `pool`. False: no memory. */
bool tm_smoothed_take(tm_tissue *tissue, const tm_tissue_def *def, tm_pool *pool);
/* Domains, members and who holds whom; nothing averaged yet. False: no memory. */
bool tm_smoothed_make_domains(const tm_tissue *tissue, tm_pool *pool, tm_domains *vertex, tm_domains *edge);
/* Sums anew what is averaged over the living tetrahedra around one vertex or edge; around all of them. */
void tm_smoothed_average(const tm_tissue *tissue, tm_domains *domains, int32_t owner);
void tm_smoothed_average_all(const tm_tissue *tissue, tm_domains *domains);
/* Every block, as a fresh build. Not cuttable: false, if there is no memory for the domains. Cuttable: never false. */
bool tm_smoothed_assemble(tm_tissue *tissue);
/* Blocks of all that is averaged with the tetrahedra around these vertices and edges, after a cut. */
void tm_smoothed_cut(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge, int32_t edges);

/* An isotropic law that lies above whatever averaging may make of this tetrahedron's after any cut; null: its own does
 * (the average of one law's strains stores no more than the law itself). */
const tm_material *tm_smoothed_cover(const tm_tissue *tissue, int32_t tet, tm_material *cover);
/* As tm_shared_eigenvalue, over domains. */
bool tm_smoothed_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);

#endif
