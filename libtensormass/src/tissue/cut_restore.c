/* A tissue as a snapshot has it: living tetrahedra, and the slots of its surface. */
#include "tissue/cut_work.h"

#include <string.h>

bool tm_tissue_surface_fits(const tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count) {
    const tm_mesh *mesh = tissue->mesh;
    if (!tissue->cuttable)
        return count == tissue->surface.count && !memcmp(face, tissue->surface.face, sizeof(int32_t) * (size_t)count);
    int32_t outer = 0, *seen = tissue->cut->fan_of; /* work space: a bit for each face */
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        if (alive[t] > 1) return false;
        seen[t] = 0;
        for (int f = 0; f < 4 && alive[t]; f++) {
            const int32_t other = mesh->tet_neighbour[4 * (int64_t)t + f];
            outer += other < 0 || !alive[other];
        }
    }
    for (int32_t i = 0; i < count; i++) {
        const int32_t f = face[i];
        if (f < 0 || f >= 4 * mesh->tet_count || !alive[f / 4] || (seen[f / 4] & 1 << f % 4)) return false;
        if (mesh->tet_neighbour[f] >= 0 && alive[mesh->tet_neighbour[f]]) return false;
        seen[f / 4] |= 1 << f % 4;
    }
    return outer == count;
}

void tm_tissue_restore(tm_tissue *tissue, const uint8_t *alive, const int32_t *face, int32_t count) {
    const tm_mesh *mesh = tissue->mesh;
    memcpy(tissue->alive, alive, (size_t)mesh->tet_count);
    tissue->alive_count = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) tissue->alive_count += alive[t];
    tm_tissue_assemble(tissue); /* which needs no memory where a tissue is cuttable */
    tm_cut_count(tissue);
    memset(tissue->face_slot, -1, sizeof(int32_t) * 4 * (size_t)mesh->tet_count);
    for (int32_t i = 0; i < count; i++) {
        const int32_t f = face[i];
        for (int k = 0; k < 3; k++)
            tissue->surface_triangle[3 * i + k] = mesh->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][k]];
        tissue->surface_face[i] = f;
        tissue->face_slot[f] = i;
    }
    tissue->surface.count = count;
    tissue->surface.revision++;
}
