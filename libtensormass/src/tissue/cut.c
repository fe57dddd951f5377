/* Removal of tetrahedra: surface, repair, then every touched vertex and edge is summed again from its active
 * tetrahedra, in the order of a fresh build. Subtraction would be simpler, and would drift. */
#include "tissue/cut_work.h"

#include <string.h>

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
    tm_cut_repair(tissue);
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

/* --- snapshots: active tetrahedra, and the slots of the surface --- */

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
    tm_tissue_assemble(tissue); /* needs no memory where a tissue is cuttable */
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

/* Rolls removed tetrahedra back: a failed step has cut nothing. Goes backwards through the list of removed ones, so
 * that every triangle gets its former slot. Then touched entities are summed again, in the order of a fresh build. */

static void put_face(tm_tissue *tissue, int32_t face, int32_t slot) {
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)(face / 4);
    for (int i = 0; i < 3; i++) tissue->surface_triangle[3 * slot + i] = v[tm_face_vertex[face % 4][i]];
    tissue->surface_face[slot] = face;
    tissue->face_slot[face] = slot;
}

/* Restores the four faces of a removed tetrahedron, the last first. */
static void take_back_surface(tm_tissue *tissue, int32_t tet, const int32_t slot[4]) {
    for (int i = 3; i >= 0; i--) {
        const int32_t face = 4 * tet + i;
        if (slot[i] >= 0) { /* it had a slot, into which the last triangle moved */
            const int32_t last = tissue->surface.count++;
            if (slot[i] != last) put_face(tissue, tissue->surface_face[slot[i]], last);
            put_face(tissue, face, slot[i]);
        } else { /* its neighbour's face appeared, as the last */
            tissue->face_slot[tissue->surface_face[--tissue->surface.count]] = -1;
        }
    }
}

bool tm_cut_rollback(tm_tissue *tissue) {
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
    tissue->surface.revision = tissue->saved_revision;
    return true;
}
