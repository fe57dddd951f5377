/* A block of Kuhn tetrahedra, six to a cube: the mesh of studies and hard cases, made in memory. */
#ifndef TM_BLOCK_H
#define TM_BLOCK_H

#include "tensormass/mesh.h"

typedef struct app_block {
    int32_t cells[3];
    int32_t vertex_count, tet_count;
    double *vertex_m; /* [3*vertex_count], x fastest */
    int32_t *tet;     /* [4*tet_count], positive; those of one cube together */
} app_block;

/* From the origin to size_m. False when memory is short. */
bool app_block_build(app_block *block, const int32_t cells[3], const double size_m[3]);
void app_block_free(app_block *block);
/* Number of the vertex at lattice (i,j,k). */
int32_t app_block_vertex(const app_block *block, int32_t i, int32_t j, int32_t k);
/* tm_mesh_create on it; `region` [tet_count] or null. */
tm_status app_block_mesh(const app_block *block, const int32_t *region, tm_mesh **mesh, tm_error *error);

#endif
