/* Tissue whose strains are smoothed (material/strain_smoothing.h): still tensor/mass, blocks on vertices and on pairs
 * of vertices, only of more pairs than the mesh has edges. */
#ifndef TM_SMOOTHED_H
#define TM_SMOOTHED_H

#include "tissue/tissue_internal.h"

/* The pairs, and work space of assembly. */
typedef struct tm_smoothed_rows {
    int32_t pair_count;
    int32_t *pair; /* [2*pair_count] k<l, ascending */
    /* of one row, and which rows a cut touched */
    int32_t *edge_index; /* [vertex_count] */
    double *block;       /* [9*most pairs of a row] */
    uint8_t *filled;     /* [most pairs of a row] */
    int32_t row_count, *row;
    uint8_t *row_waits; /* [vertex_count] */
} tm_smoothed_rows;

/* Fills tissue->smoothed and tissue->rows from the definition, from `pool`. False: no memory. */
bool tm_smoothed_init(tm_tissue *tissue, const tm_tissue_def *def, tm_pool *pool);
/* Every block, as a fresh build. Not cuttable: false, if there is no memory for the domains. Cuttable: never false. */
bool tm_smoothed_assemble(tm_tissue *tissue);
/* Blocks of all that is averaged with the tetrahedra around these vertices and edges, after a cut. */
void tm_smoothed_cut(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge, int32_t edges);
/* As tm_shared_eigenvalue, over domains. */
bool tm_smoothed_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);

#endif
