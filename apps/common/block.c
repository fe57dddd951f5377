#include <stdlib.h>
#include <string.h>

#include "block.h"

int32_t app_block_vertex(const app_block *b, int32_t i, int32_t j, int32_t k) {
    return i + (b->cells[0] + 1) * (j + (b->cells[1] + 1) * k);
}

/* Fills one cube with a tetrahedron per order of the axes, from corner to opposite corner. */
static void fill_cube(app_block *b, const int32_t corner[3], int32_t *tet) {
    static const int8_t order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    static const bool odd[6] = {false, true, true, false, false, true};
    for (int p = 0; p < 6; p++, tet += 4) {
        int32_t at[3] = {corner[0], corner[1], corner[2]};
        tet[0] = app_block_vertex(b, at[0], at[1], at[2]);
        for (int s = 0; s < 3; s++) {
            at[order[p][s]]++;
            tet[s + 1] = app_block_vertex(b, at[0], at[1], at[2]);
        }
        if (odd[p]) { /* an odd permutation inverts the tetrahedron */
            int32_t swap = tet[1];
            tet[1] = tet[2], tet[2] = swap;
        }
    }
}

bool app_block_build(app_block *b, const int32_t cells[3], const double size_m[3]) {
    memset(b, 0, sizeof *b);
    memcpy(b->cells, cells, sizeof b->cells);
    b->vertex_count = (cells[0] + 1) * (cells[1] + 1) * (cells[2] + 1);
    b->tet_count = 6 * cells[0] * cells[1] * cells[2];
    b->vertex_m = malloc(sizeof *b->vertex_m * 3 * (size_t)b->vertex_count);
    b->tet = malloc(sizeof *b->tet * 4 * (size_t)b->tet_count);
    if (!b->vertex_m || !b->tet) {
        app_block_free(b);
        return false;
    }
    for (int32_t k = 0; k <= cells[2]; k++)
        for (int32_t j = 0; j <= cells[1]; j++)
            for (int32_t i = 0; i <= cells[0]; i++) {
                double *v = b->vertex_m + 3 * app_block_vertex(b, i, j, k);
                v[0] = size_m[0] * i / cells[0], v[1] = size_m[1] * j / cells[1], v[2] = size_m[2] * k / cells[2];
            }
    int32_t *tet = b->tet;
    for (int32_t k = 0; k < cells[2]; k++)
        for (int32_t j = 0; j < cells[1]; j++)
            for (int32_t i = 0; i < cells[0]; i++, tet += 24) fill_cube(b, (int32_t[3]){i, j, k}, tet);
    return true;
}

void app_block_free(app_block *b) {
    free(b->vertex_m);
    free(b->tet);
    memset(b, 0, sizeof *b);
}

tm_status app_block_mesh(const app_block *b, const int32_t *region, tm_mesh **mesh, tm_error *error) {
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = b->vertex_count, def.vertex_m = b->vertex_m;
    def.tet_count = b->tet_count, def.tet = b->tet, def.region = region;
    return tm_mesh_create(&def, mesh, error);
}
