/* Where the tensor/mass part ends. Marked by tetrahedra's centres, its border may run through a layer of cells in
 * teeth, with twice the vertices that a smooth one has; and what it costs grows with their square. */
#include "hybrid.h"

#include <string.h>

enum { ROUNDS = 4 };             /* the teeth of one layer are full after two */
static const double WORTH = 0.2; /* of the border's vertices: less is not worth another part than was asked for */

static int32_t count_border(const tm_mesh *mesh, const uint8_t *alive, uint8_t *part) {
    int32_t count = 0;
    memset(part, 0, (size_t)mesh->vertex_count);
    for (int32_t i = 0; i < 4 * mesh->tet_count; i++) part[mesh->tet[i]] |= alive[i / 4] ? TMS_DYNAMIC : TMS_CONDENSED;
    for (int32_t v = 0; v < mesh->vertex_count; v++) count += part[v] == TMS_INTERFACE;
    return count;
}

/* Condensed tetrahedra with two faces and more on the other part join it. Returns how many. */
static int32_t fill(const tm_mesh *mesh, const uint8_t *alive, uint8_t *next) {
    int32_t joined = 0;
    memcpy(next, alive, (size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        int faces = 0;
        for (int i = 0; i < 4 && !alive[t]; i++) {
            const int32_t other = mesh->tet_neighbour[4 * (int64_t)t + i];
            faces += other >= 0 && alive[other];
        }
        if (faces >= 2) next[t] = 1, joined++;
    }
    return joined;
}

bool tms_hybrid_smooth(const tm_mesh *mesh, uint8_t *alive) {
    const size_t tets = (size_t)mesh->tet_count;
    uint8_t *memory = tms_take(2 * tets + (size_t)mesh->vertex_count);
    if (!memory) return false;
    uint8_t *now = memory, *next = memory + tets, *part = memory + 2 * tets;
    const int32_t before = count_border(mesh, alive, part);
    memcpy(now, alive, tets);
    for (int round = 0; round < ROUNDS && fill(mesh, now, next) > 0; round++) {
        uint8_t *const other = now;
        now = next;
        next = other;
    }
    const int32_t after = count_border(mesh, now, part);
    if (after > 0 && after < (1 - WORTH) * before) memcpy(alive, now, tets);
    tms_give(memory);
    return true;
}
