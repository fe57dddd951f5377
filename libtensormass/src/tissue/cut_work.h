/* Work space of cutting, allocated with a cuttable tissue, and functions that cut*.c share. */
#ifndef TM_CUT_WORK_H
#define TM_CUT_WORK_H

#include "tissue/tissue_internal.h"

/* A queue that holds each item at most once. */
typedef struct tm_cut_queue {
    int32_t capacity, begin, count;
    int32_t *item;  /* [capacity] ring buffer */
    uint8_t *waits; /* [capacity] by item */
} tm_cut_queue;

/* The items seen in this call, each once. */
typedef struct tm_cut_list {
    int32_t count;
    int32_t *item;
    uint32_t *stamp; /* by item: the last call that saw it */
} tm_cut_list;

static inline void tm_cut_see(tm_cut_list *list, uint32_t call, int32_t item) {
    if (list->stamp[item] == call) return;
    list->stamp[item] = call;
    list->item[list->count++] = item;
}

typedef struct tm_cut_work {
    uint32_t call;
    tm_cut_list vertex, edge, tet;          /* touched (vertices, edges), removed (tetrahedra) in this call */
    tm_cut_queue vertex_check, edge_check;  /* whose fans are still to be checked */
    int32_t *edge_alive, *vertex_alive;     /* present tetrahedra around an edge, a vertex */
    int32_t *edge_whole, *vertex_whole;     /* number that closes all around it; -1: on the mesh's surface, never */
    int32_t star_max;                       /* most tetrahedra around a vertex */
    int32_t *star, *fan, *stack;            /* [star_max] of the checked vertex or edge */
    int32_t *rim_tet, *rim_face, *rim_loop; /* [3*star_max] outer faces at the checked vertex */
    uint32_t fan_call;
    uint32_t *fan_stamp; /* [tet_count] */
    int32_t *fan_of;     /* [tet_count] index in star */
    /* Tetrahedra removed since the step began, oldest first, and the surface slots of their faces (-1: the face was
     * inside, and the neighbour's face appeared). */
    int32_t *undo_tet, *undo_slot; /* [tet_count], [4*tet_count] */
} tm_cut_work;

/* Returns whether a tetrahedron is active or condensed: both count for repair. */
static inline bool tm_cut_is_there(const tm_tissue *tissue, int32_t tet) {
    return tissue->alive[tet] || (tissue->condensed && tissue->condensed[tet]);
}

tm_cut_work *tm_cut_init_work(tm_pool *pool, const tm_mesh *mesh);
/* Counts the active tetrahedra around edges and vertices. */
void tm_cut_count(tm_tissue *tissue);
/* Local edge between two local vertices. */
extern const int8_t tm_cut_edge_between[4][4];

/* Removes one active tetrahedron: mark and counts. What it touched is queued for checks, surface and tensors. */
void tm_cut_kill(tm_tissue *tissue, int32_t tet);
/* Removes tetrahedra that hang by a vertex or an edge, until none does, and restores those that can stay after all. */
void tm_cut_repair(tm_tissue *tissue);
void tm_cut_queue_push(tm_cut_queue *queue, int32_t item);
int32_t tm_cut_queue_pop(tm_cut_queue *queue);

#endif
