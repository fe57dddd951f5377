/* Removal of tetrahedra: surface, mending, then every touched vertex and edge summed again from its living tetrahedra, in the order of
 * a fresh build. Subtracting would be quicker to write and would drift. */
#include "cut_internal.h"

#include <assert.h>

static void take_list(tm_cut_list *list, tm_pool *pool, int32_t count) {
    list->item = TM_TAKE(pool, int32_t, count);
    list->stamp = TM_TAKE(pool, uint32_t, count);
}

static void take_queue(tm_cut_queue *queue, tm_pool *pool, int32_t capacity) {
    queue->capacity = capacity;
    queue->item = TM_TAKE(pool, int32_t, capacity);
    queue->waits = TM_TAKE(pool, uint8_t, capacity);
}

tm_cut_work *tm_cut_take_work(tm_pool *pool, const tm_mesh *mesh) {
    tm_cut_work *w = TM_TAKE(pool, tm_cut_work, 1);
    if (!w) return NULL;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const int32_t star = mesh->vertex_tet_begin[v + 1] - mesh->vertex_tet_begin[v];
        if (star > w->star_max) w->star_max = star;
    }
    take_list(&w->vertex, pool, mesh->vertex_count);
    take_list(&w->edge, pool, mesh->edge_count);
    take_list(&w->tet, pool, mesh->tet_count);
    take_queue(&w->vertex_check, pool, mesh->vertex_count);
    take_queue(&w->edge_check, pool, mesh->edge_count);
    w->edge_alive = TM_TAKE(pool, int32_t, mesh->edge_count);
    w->star = TM_TAKE(pool, int32_t, w->star_max);
    w->fan = TM_TAKE(pool, int32_t, w->star_max);
    w->stack = TM_TAKE(pool, int32_t, w->star_max);
    w->rim_tet = TM_TAKE(pool, int32_t, 3 * (int64_t)w->star_max);
    w->rim_face = TM_TAKE(pool, int32_t, 3 * (int64_t)w->star_max);
    w->rim_loop = TM_TAKE(pool, int32_t, 3 * (int64_t)w->star_max);
    w->fan_stamp = TM_TAKE(pool, uint32_t, mesh->tet_count);
    w->fan_of = TM_TAKE(pool, int32_t, mesh->tet_count);
    return w;
}

void tm_cut_count_edges(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        tissue->cut->edge_alive[e] = 0;
        for (int32_t i = mesh->edge_tet_begin[e]; i < mesh->edge_tet_begin[e + 1]; i++)
            tissue->cut->edge_alive[e] += tissue->alive[mesh->edge_tet[i]];
    }
}

static void see(tm_cut_list *list, uint32_t call, int32_t item) {
    if (list->stamp[item] == call) return;
    list->stamp[item] = call;
    list->item[list->count++] = item;
}

static void push(tm_cut_queue *queue, int32_t item) {
    if (queue->waits[item]) return;
    queue->waits[item] = 1;
    int32_t end = queue->begin + queue->count++;
    if (end >= queue->capacity) end -= queue->capacity;
    queue->item[end] = item;
}

int32_t tm_cut_queue_pop(tm_cut_queue *queue) {
    const int32_t item = queue->item[queue->begin];
    queue->begin = queue->begin + 1 == queue->capacity ? 0 : queue->begin + 1;
    queue->count--;
    queue->waits[item] = 0;
    return item;
}

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
    for (int i = 0; i < 4; i++) {
        const int32_t face = 4 * tet + i, neighbour = tissue->mesh->tet_neighbour[face];
        if (tissue->face_slot[face] >= 0) {
            hide_face(tissue, face);
            continue;
        }
        int back = 0;
        while (tissue->mesh->tet_neighbour[4 * neighbour + back] != tet) back++;
        show_face(tissue, 4 * neighbour + back);
    }
}

void tm_cut_kill(tm_tissue *tissue, int32_t tet) {
    tm_cut_work *w = tissue->cut;
    tissue->alive[tet] = 0;
    tissue->alive_count--;
    see(&w->tet, w->call, tet);
    update_surface(tissue, tet);
    for (int e = 0; e < 6; e++) {
        const int32_t edge = tissue->mesh->tet_edge[6 * (int64_t)tet + e];
        w->edge_alive[edge]--;
        see(&w->edge, w->call, edge);
        push(&w->edge_check, edge);
    }
    for (int i = 0; i < 4; i++) {
        const int32_t vertex = tissue->mesh->tet[4 * (int64_t)tet + i];
        see(&w->vertex, w->call, vertex);
        push(&w->vertex_check, vertex);
    }
}

int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed, int32_t removed_max) {
    assert(tissue->cuttable);
    if (!tissue->cuttable) return 0;
    tm_cut_work *w = tissue->cut;
    w->call++;
    w->vertex.count = w->edge.count = w->tet.count = 0;
    for (int32_t i = 0; i < count; i++) {
        assert(tet[i] >= 0 && tet[i] < tissue->mesh->tet_count);
        if (tissue->alive[tet[i]]) tm_cut_kill(tissue, tet[i]);
    }
    tm_cut_mend(tissue);
    for (int32_t i = 0; i < w->vertex.count; i++) tm_tissue_assemble_vertex(tissue, w->vertex.item[i]);
    for (int32_t i = 0; i < w->edge.count; i++) tm_tissue_assemble_edge(tissue, w->edge.item[i]);
    tissue->surface.revision += w->tet.count > 0;
    for (int32_t i = 0; removed && i < w->tet.count && i < removed_max; i++) removed[i] = w->tet.item[i];
    return w->tet.count;
}
