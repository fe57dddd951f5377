/* Strain smoothing (effect "strain_smoothing"), against locking (docs/strain-smoothing.md). The dilatation is averaged
 * over the tetrahedra around a vertex, a share of the shear over those around an edge. */
#ifndef TM_STRAIN_SMOOTHING_H
#define TM_STRAIN_SMOOTHING_H

#include "material/material_field.h"

/* Smoothing domains: for each vertex, or edge, and each law around it the active tetrahedra of that law. Numbered by
 * owner, then by the law's first tetrahedron. */
typedef struct tm_domains {
    bool of_edges;
    int32_t count, member_count;
    int32_t *begin;     /* [owners+1] first domain of each vertex or edge */
    int32_t *law;       /* [count] the first region that has it */
    int32_t *member_at; /* [count+1] */
    int32_t *member;    /* [member_count] vertices, ascending within a domain */
    uint8_t *lives;     /* [member_count] 1: an active tetrahedron of the domain has it */
    double *gradient;   /* [3*member_count] of the averaged strain by the member's displacement, 1/m */
    double *volume_m3;  /* [count] share of the active tetrahedra's */
    double *law_Pa;     /* [36*count] averaged elasticity (Voigt) where fibres may differ; else null */
    int32_t *held_at;   /* [vertex_count+1] */
    int32_t *held_by;   /* [member_count] domains of a vertex, ascending */
    int32_t *held_as;   /* [member_count] member index of the vertex there */
} tm_domains;

/* Division of the law, and the domains of its averaged parts. */
typedef struct tm_smoothed {
    double shear;           /* share of the shear that is averaged over edges */
    int32_t *law;           /* [region_count] the first region with the same elastic constants; -1: not smoothed */
    double *bulk_Pa;        /* [region_count] averaged over vertices; 0: not smoothed */
    tm_material *remainder; /* [region_count] the law without it */
    /* Cuttable: kept for the tissue's lifetime. Otherwise built for assembly and for the critical step, then freed. */
    tm_domains vertex, edge;
} tm_smoothed;

/* Returns whether the strains of a tetrahedron are averaged. */
static inline bool tm_field_is_smoothed(const tm_material_field *field, int32_t tet) {
    return field->smoothed && field->smoothed->law[field->mesh->region[tet]] >= 0;
}

/* Builds domains, members and the domains of each vertex; averages nothing yet. Returns false without memory. */
bool tm_smoothed_build_domains(const tm_material_field *field, tm_pool *pool, tm_domains *vertex, tm_domains *edge);
/* Recomputes the averages over the active tetrahedra around one vertex or edge; around all of them. */
void tm_smoothed_average(const tm_material_field *field, tm_domains *domains, int32_t owner);
void tm_smoothed_average_all(const tm_material_field *field, tm_domains *domains);
/* Returns an isotropic law that bounds any average with this tetrahedron's after any cut. Null: its own law does,
 * because the average of one law's strains stores no more than the law itself. */
const tm_material *tm_smoothed_cover(const tm_material_field *field, int32_t tet, tm_material *cover);

#endif
