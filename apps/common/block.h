/* A block of Kuhn tetrahedra, six per cube, built in memory for studies and stability cases. */
#ifndef TM_BLOCK_H
#define TM_BLOCK_H

#include "tensormass/mesh.h"

typedef struct app_block {
    int32_t cells[3];
    int32_t vertex_count, tet_count;
    double *vertex_m; /* [3*vertex_count], x fastest */
    int32_t *tet;     /* [4*tet_count], positive volume; tetrahedra of one cube are adjacent */
} app_block;

/* Builds the block from the origin to size_m. Returns false if memory is exhausted. */
bool app_block_build(app_block *block, const int32_t cells[3], const double size_m[3]);
void app_block_free(app_block *block);
/* Returns the index of the vertex at lattice point (i,j,k). */
int32_t app_block_vertex(const app_block *block, int32_t i, int32_t j, int32_t k);
/* Calls tm_mesh_create on the block; `region` is [tet_count] or null. */
tm_status app_block_mesh(const app_block *block, const int32_t *region, tm_mesh **mesh, tm_error *error);

#endif
