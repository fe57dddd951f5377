/* Removal of tetrahedra: surface, mending, then every touched vertex and edge summed again from its living tetrahedra,
 * in the order of a fresh build. Subtracting would be quicker to write and would drift. */
#include "tissue/cut_work.h"

/* --- surface --- */

static void hide_face(tm_tissue *tissue, int32_t face) {
    const int32_t slot = tissue->face_slot[face], last = --tissue->surface.count;
    for (int i = 0; i < 3; i++) tissue->surface_triangle[3 * slot + i] = tissue->surface_triangle[3 * last + i];
    tissue->surface_face[slot] = tissue->surface_face[last];
    tissue->face_slot[tissue->surface_face[slot]] = slot;
    tissue->face_slot[face] = -1;
}

static void show_face(tm_tissue *tissue, int32_t face) {
    const int32_t slot = tissue->surface.count++, *v = tissue->mesh->tet + 4 * (int64_t)(face / 4);
    for (int i = 0; i < 3; i++) tissue->surface_triangle[3 * slot + i] = v[tm_face_vertex[face % 4][i]];
    tissue->surface_face[slot] = face;
    tissue->face_slot[face] = slot;
}

static void update_surface(tm_tissue *tissue, int32_t tet) {
    tm_cut_work *w = tissue->cut;
    int32_t *slot = w->undo_slot + 4 * (int64_t)tissue->undo_count;
    w->undo_tet[tissue->undo_count++] = tet;
    for (int i = 0; i < 4; i++) {
        const int32_t face = 4 * tet + i, neighbour = tissue->mesh->tet_neighbour[face];
        slot[i] = tissue->face_slot[face];
        if (slot[i] >= 0) {
            hide_face(tissue, face);
            continue;
        }
        int back = 0;
        while (tissue->mesh->tet_neighbour[4 * neighbour + back] != tet) back++;
        show_face(tissue, 4 * neighbour + back);
    }
}

int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed, int32_t removed_max) {
    TM_REQUIRE(tissue && tissue->cuttable, "tissue is null or was not made cuttable", 0);
    TM_REQUIRE(count >= 0 && (tet || count == 0) && removed_max >= 0, "tet is null or a count is negative", 0);
    for (int32_t i = 0; i < count; i++)
        TM_REQUIRE(tet[i] >= 0 && tet[i] < tissue->mesh->tet_count, "tet names no tetrahedron of the tissue", 0);
    tm_cut_work *w = tissue->cut;
    w->call++;
    w->vertex.count = w->edge.count = w->tet.count = 0;
    for (int32_t i = 0; i < count; i++)
        if (tissue->alive[tet[i]]) tm_cut_kill(tissue, tet[i]);
    tm_cut_mend(tissue);
    for (int32_t i = 0; i < w->tet.count; i++) update_surface(tissue, w->tet.item[i]);
    for (int32_t i = 0; !tissue->smoothed && i < w->edge.count; i++)
        if (!tm_tissue_edge_lives(tissue, w->edge.item[i])) tm_tissue_drop_edge(tissue, w->edge.item[i]);
    tm_tissue_assemble_touched(tissue, w->vertex.item, w->vertex.count, w->edge.item, w->edge.count);
    tissue->surface.revision += w->tet.count > 0;
    for (int32_t i = 0; removed && i < w->tet.count && i < removed_max; i++) removed[i] = w->tet.item[i];
    return w->tet.count;
}

int32_t tm_cut_removed(const tm_tissue *tissue, const int32_t **tet) {
    *tet = tissue->cut->tet.item;
    return tissue->cut->tet.count;
}

int32_t tm_cut_touched(const tm_tissue *tissue, const int32_t **vertex) {
    *vertex = tissue->cut->vertex.item;
    return tissue->cut->vertex.count;
}
