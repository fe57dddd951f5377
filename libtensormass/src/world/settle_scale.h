/* What counts as a large force while tissue settles. */
#ifndef TM_SETTLE_SCALE_H
#define TM_SETTLE_SCALE_H

#include "tissue/tissue_internal.h"

/* What forces are large or small beside, where none is left at rest: a body that was turned or moved as a whole. */
typedef struct tm_force_scale {
    double stiffness_N_m; /* the largest entry of vertex tensors */
    double size_m;        /* diagonal of the mesh's bounds */
} tm_force_scale;
tm_force_scale tm_force_scale_of(const tm_tissue *tissue);
/* The least force that counts as 1 in a residual: 1e-4 of the stiffness times the largest displacement, above what
 * rounding leaves at a tolerance of 1e-10; and 1e-9 of the stiffness times the size. */
double tm_force_scale_at(const tm_force_scale *scale, const double *u_m, int32_t n);

#endif
