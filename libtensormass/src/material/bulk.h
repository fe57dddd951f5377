/* Force of the bulk modulus alone, without tensors: for the stage "viscosity" where volume and shear relax by different
 * shares. */
#ifndef TM_BULK_H
#define TM_BULK_H

#include "material/effect_range.h"
#include "material/strain_smoothing.h"

typedef struct tm_bulk {
    tm_material_field field;
    tm_ranges tets;         /* that relax and are not smoothed */
    double *stiffness_J;    /* of these: bulk modulus times volume, by the mesh's tetrahedra */
    tm_domains own_domains; /* smoothed, not cuttable: the domains of vertices */
} tm_bulk;

/* Returns false without memory. */
bool tm_bulk_init(tm_bulk *bulk, tm_pool *pool, const tm_material_field *field);
/* force_N += W u on the vertices [begin, end), W the bulk modulus' part of K. Sums ascend over active tetrahedra or
 * domains, so results are bit-identical for any partition. An edge across a partition end is computed on both sides. */
void tm_bulk_add(const tm_bulk *bulk, int32_t begin, int32_t end, const double *u_m, double *force_N);

#endif
