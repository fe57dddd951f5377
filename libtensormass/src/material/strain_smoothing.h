/* Strain smoothing (effect "strain_smoothing"): strain averaged over the tetrahedra around a vertex for the change of
 * volume, around an edge for a share of the shear, so that tissue does not lock (docs/strain-smoothing.md). */
#ifndef TM_STRAIN_SMOOTHING_H
#define TM_STRAIN_SMOOTHING_H

#include "material/material_field.h"

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

/* How the law is divided, and what that is averaged over. */
typedef struct tm_smoothed {
    double shear;           /* share of the shear that is averaged over edges */
    int32_t *law;           /* [region_count] the first region with the same elastic constants */
    double *bulk_Pa;        /* [region_count] what is averaged over vertices */
    tm_material *remainder; /* [region_count] the law without it */
    /* Cuttable: kept for life. Otherwise made for building and for the critical step, and given back. */
    tm_domains vertex, edge;
} tm_smoothed;

/* Domains, members and who holds whom; nothing averaged yet. False: no memory. */
bool tm_smoothed_build_domains(const tm_material_field *field, tm_pool *pool, tm_domains *vertex, tm_domains *edge);
/* Sums anew what is averaged over the active tetrahedra around one vertex or edge; around all of them. */
void tm_smoothed_average(const tm_material_field *field, tm_domains *domains, int32_t owner);
void tm_smoothed_average_all(const tm_material_field *field, tm_domains *domains);
/* An isotropic law that lies above whatever averaging may make of this tetrahedron's after any cut; null: its own does
 * (the average of one law's strains stores no more than the law itself). */
const tm_material *tm_smoothed_cover(const tm_material_field *field, int32_t tet, tm_material *cover);

#endif
