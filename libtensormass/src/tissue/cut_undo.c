/* Gives removed tetrahedra back: a step that fails has cut nothing. Backwards through the list of what went, so that
 * every triangle finds the slot it had; then what was touched is summed again, in the order of a fresh build. */
#include "tissue/cut_work.h"

static void put_face(tm_tissue *tissue, int32_t face, int32_t slot) {
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)(face / 4);
    for (int i = 0; i < 3; i++) tissue->surface_triangle[3 * slot + i] = v[tm_face_vertex[face % 4][i]];
    tissue->surface_face[slot] = face;
    tissue->face_slot[face] = slot;
}

/* Undoes what became of the four faces when the tetrahedron went: the last first. */
static void take_back_surface(tm_tissue *tissue, int32_t tet, const int32_t slot[4]) {
    for (int i = 3; i >= 0; i--) {
        const int32_t face = 4 * tet + i;
        if (slot[i] >= 0) { /* it had a slot, into which the last triangle moved */
            const int32_t last = tissue->surface.count++;
            if (slot[i] != last) put_face(tissue, tissue->surface_face[slot[i]], last);
            put_face(tissue, face, slot[i]);
        } else { /* its neighbour's side came out, as the last */
            tissue->face_slot[tissue->surface_face[--tissue->surface.count]] = -1;
        }
    }
}

bool tm_cut_give_back(tm_tissue *tissue) {
    if (tissue->undo_count == 0) return false;
    tm_cut_work *w = tissue->cut;
    w->call++;
    w->vertex.count = w->edge.count = w->tet.count = 0;
    while (tissue->undo_count > 0) {
        const int32_t tet = w->undo_tet[--tissue->undo_count];
        take_back_surface(tissue, tet, w->undo_slot + 4 * (int64_t)tissue->undo_count);
        tissue->alive[tet] = 1;
        tissue->alive_count++;
        for (int e = 0; e < 6; e++) {
            const int32_t edge = tissue->mesh->tet_edge[6 * (int64_t)tet + e];
            w->edge_alive[edge]++;
            tm_cut_see(&w->edge, w->call, edge);
        }
        for (int i = 0; i < 4; i++) {
            const int32_t vertex = tissue->mesh->tet[4 * (int64_t)tet + i];
            w->vertex_alive[vertex]++;
            tm_cut_see(&w->vertex, w->call, vertex);
        }
    }
    for (int32_t i = 0; !tissue->smoothed && i < w->edge.count; i++) tm_tissue_raise_edge(tissue, w->edge.item[i]);
    tm_tissue_assemble_touched(tissue, w->vertex.item, w->vertex.count, w->edge.item, w->edge.count);
    tissue->surface.revision = tissue->kept_revision;
    return true;
}
