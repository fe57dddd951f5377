/* The work space of cutting: counts around edges and vertices, queues of fans to check, and removal of one
 * tetrahedron. */
#include "tissue/cut_work.h"

const int8_t tm_cut_edge_between[4][4] = {{-1, 0, 1, 2}, {0, -1, 3, 4}, {1, 3, -1, 5}, {2, 4, 5, -1}};

static void alloc_list(tm_cut_list *list, tm_pool *pool, int32_t count) {
    list->item = TM_ALLOC(pool, int32_t, count);
    list->stamp = TM_ALLOC(pool, uint32_t, count);
}

static void alloc_queue(tm_cut_queue *queue, tm_pool *pool, int32_t capacity) {
    queue->capacity = capacity;
    queue->item = TM_ALLOC(pool, int32_t, capacity);
    queue->waits = TM_ALLOC(pool, uint8_t, capacity);
}

tm_cut_work *tm_cut_init_work(tm_pool *pool, const tm_mesh *mesh) {
    tm_cut_work *w = TM_ALLOC(pool, tm_cut_work, 1);
    if (!w) return NULL;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const int32_t star = mesh->vertex_tet_begin[v + 1] - mesh->vertex_tet_begin[v];
        if (star > w->star_max) w->star_max = star;
    }
    alloc_list(&w->vertex, pool, mesh->vertex_count);
    alloc_list(&w->edge, pool, mesh->edge_count);
    alloc_list(&w->tet, pool, mesh->tet_count);
    alloc_queue(&w->vertex_check, pool, mesh->vertex_count);
    alloc_queue(&w->edge_check, pool, mesh->edge_count);
    w->edge_alive = TM_ALLOC(pool, int32_t, mesh->edge_count);
    w->vertex_alive = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    w->edge_whole = TM_ALLOC(pool, int32_t, mesh->edge_count);
    w->vertex_whole = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    w->star = TM_ALLOC(pool, int32_t, w->star_max);
    w->fan = TM_ALLOC(pool, int32_t, w->star_max);
    w->stack = TM_ALLOC(pool, int32_t, w->star_max);
    w->rim_tet = TM_ALLOC(pool, int32_t, 3 * (int64_t)w->star_max);
    w->rim_face = TM_ALLOC(pool, int32_t, 3 * (int64_t)w->star_max);
    w->rim_loop = TM_ALLOC(pool, int32_t, 3 * (int64_t)w->star_max);
    w->fan_stamp = TM_ALLOC(pool, uint32_t, mesh->tet_count);
    w->fan_of = TM_ALLOC(pool, int32_t, mesh->tet_count);
    w->undo_tet = TM_ALLOC(pool, int32_t, mesh->tet_count);
    w->undo_slot = TM_ALLOC(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    return w;
}

void tm_cut_count(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    tm_cut_work *w = tissue->cut;
    tissue->undo_count = 0; /* each tetrahedron is removed once: the list is long enough */
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        w->edge_alive[e] = 0;
        w->edge_whole[e] = mesh->edge_tet_begin[e + 1] - mesh->edge_tet_begin[e];
        for (int32_t i = mesh->edge_tet_begin[e]; i < mesh->edge_tet_begin[e + 1]; i++)
            w->edge_alive[e] += tm_cut_is_there(tissue, mesh->edge_tet[i]);
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        w->vertex_alive[v] = 0;
        w->vertex_whole[v] = mesh->vertex_tet_begin[v + 1] - mesh->vertex_tet_begin[v];
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++)
            w->vertex_alive[v] += tm_cut_is_there(tissue, mesh->vertex_tet[i]);
    }
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
        if (mesh->tet_neighbour[f] >= 0) continue;
        for (int i = 0; i < 3; i++) w->vertex_whole[mesh->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][i]]] = -1;
        for (int e = 0; e < 6; e++)
            if (tm_edge_vertex[e][0] != f % 4 && tm_edge_vertex[e][1] != f % 4)
                w->edge_whole[mesh->tet_edge[6 * (int64_t)(f / 4) + e]] = -1;
    }
}

void tm_cut_queue_push(tm_cut_queue *queue, int32_t item) {
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

/* Queues the edges and vertices whose fans may split when this tetrahedron is removed. Only they are checked
 * afterwards.
 *
 * Around an edge the fan splits only if both neighbours are active and the fan was not closed. Around a vertex the
 * tetrahedron is a triangle of the star's section. With no free side it opens a new outline (except the first in a
 * closed star). With one free side it may split the star if the opposite corner is on the outline too. With two or
 * three it is an ear. For a split edge the ends are queued as well. */
static void find_may_detach(tm_tissue *tissue, int32_t tet) {
    tm_cut_work *w = tissue->cut;
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)tet, *edge = tissue->mesh->tet_edge + 6 * (int64_t)tet;
    bool joined[4], closed[6];
    for (int i = 0; i < 4; i++) {
        const int32_t other = tissue->mesh->tet_neighbour[4 * (int64_t)tet + i];
        joined[i] = other >= 0 && tm_cut_is_there(tissue, other);
    }
    for (int e = 0; e < 6; e++) {
        const int a = tm_edge_vertex[e][0], b = tm_edge_vertex[e][1], c = tm_edge_vertex[5 - e][0],
                  d = tm_edge_vertex[5 - e][1];
        closed[e] = w->edge_alive[edge[e]] == w->edge_whole[edge[e]];
        if (closed[e] || !joined[c] || !joined[d]) continue;
        tm_cut_queue_push(&w->edge_check, edge[e]);
        tm_cut_queue_push(&w->vertex_check, v[a]);
        tm_cut_queue_push(&w->vertex_check, v[b]);
    }
    for (int i = 0; i < 4; i++) {
        int sides = 0, free_side = 0;
        for (int j = 0; j < 4; j++) {
            if (j == i) continue;
            sides += joined[j];
            if (!joined[j]) free_side = j;
        }
        const bool may_detach = sides == 3 ? w->vertex_alive[v[i]] != w->vertex_whole[v[i]]
                                           : sides == 2 && !closed[tm_cut_edge_between[i][free_side]];
        if (may_detach) tm_cut_queue_push(&w->vertex_check, v[i]);
    }
}

void tm_cut_kill(tm_tissue *tissue, int32_t tet) {
    tm_cut_work *w = tissue->cut;
    find_may_detach(tissue, tet);
    tissue->alive[tet] = 0;
    tissue->alive_count--;
    tm_cut_see(&w->tet, w->call, tet);
    for (int e = 0; e < 6; e++) {
        const int32_t edge = tissue->mesh->tet_edge[6 * (int64_t)tet + e];
        w->edge_alive[edge]--;
        tm_cut_see(&w->edge, w->call, edge);
    }
    for (int i = 0; i < 4; i++) {
        const int32_t vertex = tissue->mesh->tet[4 * (int64_t)tet + i];
        w->vertex_alive[vertex]--;
        tm_cut_see(&w->vertex, w->call, vertex);
    }
}
