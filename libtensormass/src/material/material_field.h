/* The materials of a mesh: tissue data that laws read. */
#ifndef TM_MATERIAL_FIELD_H
#define TM_MATERIAL_FIELD_H

#include "base/simd.h"
#include "mesh/mesh_internal.h"
#include "tensormass/tissue.h"

/* A view: the arrays belong to the tissue, which may deactivate tetrahedra. */
typedef struct tm_material_field {
    const tm_mesh *mesh;
    const uint8_t *alive;               /* [tet_count] */
    const tm_material *material;        /* [material_count] */
    const int32_t *region_material;     /* [region_count] */
    const double *fibre;                /* [3*tet_count] or null */
    const struct tm_smoothed *smoothed; /* null: linear tetrahedra (strain_smoothing.h) */
    double rotation;                    /* |grad u| above which tetrahedra are corotated; 0: none is */
    const double *stiffest_Pa;          /* [material_count] bound of d2W/dF2 of nonlinear laws; null: all are linear */
    int32_t material_count;
    const uint8_t *effects; /* [region_count] sums of tm_region_effect; null: all effects act everywhere */
    bool plain;             /* plain form of all loops */
} tm_material_field;

static inline const tm_material *tm_field_material(const tm_material_field *field, int32_t tet) {
    return field->material + field->region_material[field->mesh->region[tet]];
}
static inline const double *tm_field_fibre(const tm_material_field *field, int32_t tet) {
    return field->fibre ? field->fibre + 3 * (int64_t)tet : NULL;
}

/* All of them. */
enum { TM_REGION_EFFECTS = TM_REGION_ROTATION | TM_REGION_SMOOTHING | TM_REGION_VISCOSITY };
/* Returns whether these effects (a sum of tm_region_effect), if the tissue has them, all act in this tetrahedron. */
static inline bool tm_field_has(const tm_material_field *field, int32_t tet, int effects) {
    return !field->effects || (field->effects[field->mesh->region[tet]] & effects) == effects;
}

/* Largest exponent of a law at its limit of stretch. */
#define TM_EXPONENT_MAX 6.0
/* Checks the constants of a material's law. */
tm_status tm_law_check(const tm_material *material, tm_error *error);

/* Returns the largest bulk modulus whose subtraction leaves the law semidefinite: 1 / (m.C^-1 m), m the unit tensor;
 * lambda + 2/3 mu of isotropic tissue. */
double tm_material_bulk_Pa(const tm_material *material);
/* Returns the long-term law, fully relaxed: shares `shear` and `volume` of its moduli. */
tm_material tm_material_relaxed(const tm_material *material, double shear, double volume);

#endif
