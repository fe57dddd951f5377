/* Energies and forces of a nonlinear law at the last displacements for which they were asked: two of the three that the
 * energy account needs in a step were needed in the step before. */
#ifndef TM_LAW_MEMO_H
#define TM_LAW_MEMO_H

#include "world/world_internal.h"

enum { TM_LAW_MEMO = 3 };

typedef struct tm_law_memo {
    int64_t bytes; /* of the displacements; 0: nothing is kept */
    struct {
        double *u_m, *force_N; /* [3*vertex_count] */
        double energy_J;
        bool known;
    } at[TM_LAW_MEMO];
    int32_t next; /* to be replaced, the oldest */
    int32_t revision;
    const tm_nonlinear *law;
} tm_law_memo;

/* Allocates. */
void tm_law_memo_init(tm_law_memo *memo, tm_pool *pool, const tm_mesh *mesh);
void tm_law_memo_forget(tm_law_memo *memo);
/* Computes the energy and the force of the world's law at u_m. Returns the force [3*vertex_count], valid until the next
 * call. */
const double *tm_law_memo_get(tm_law_memo *memo, const tm_world *world, const double *u_m, double *energy_J);

#endif
