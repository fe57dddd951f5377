/* Smoothed tissue (material/strain_smoothing.h) as tensor/mass: blocks on vertices and on pairs of vertices, with more
 * pairs than the mesh has edges. */
#ifndef TM_SMOOTHED_H
#define TM_SMOOTHED_H

#include "tissue/tissue_internal.h"

/* The pairs, and work space of assembly. */
typedef struct tm_smoothed_rows {
    int32_t pair_count;
    int32_t *pair; /* [2*pair_count] k<l, ascending */
    /* of one row, and the rows that a cut touched */
    int32_t *edge_index; /* [vertex_count] */
    double *block;       /* [9*most pairs of a row] */
    uint8_t *filled;     /* [most pairs of a row] */
    int32_t row_count, *row;
    uint8_t *row_waits; /* [vertex_count] */
} tm_smoothed_rows;

/* Fills tissue->smoothed and tissue->rows from the definition and `pool`. Returns false without memory. */
bool tm_smoothed_init(tm_tissue *tissue, const tm_tissue_def *def, tm_pool *pool);
/* Assembles every block anew. Not cuttable: returns false without memory for the domains. Cuttable: always true. */
bool tm_smoothed_assemble(tm_tissue *tissue);
/* Reassembles, after a cut, the blocks of all domains of the tetrahedra around these vertices and edges. */
void tm_smoothed_cut(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge, int32_t edges);
/* As tm_shared_eigenvalue, over domains. */
bool tm_smoothed_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet);

#endif
