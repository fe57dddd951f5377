/* Ties between bodies: ligaments and fat as springs that pull and never push, each from a vertex to a point of another
 * surface. A tie breaks at its breaking load, is cut by an active cautery that touches it, and goes with the tissue at
 * its ends (docs/bodies.md, "Ties"). One stage, "ties". Add it after contact, if there is any: both are then swept
 * together. */
#ifndef TENSORMASS_TIES_H
#define TENSORMASS_TIES_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tm_ties tm_ties;

typedef struct tm_tie {
    int32_t vertex, other[3]; /* from a vertex to the point of these three */
    double weight[3];         /* barycentric, sum 1 */
    double rest_m;            /* length up to which it is slack */
    double stiffness_N_m;     /* > 0 */
    double break_N;           /* breaking load; 0: none */
} tm_tie;

typedef struct tm_ties_def {
    uint32_t cookie, size;
    int32_t count;
    const tm_tie *tie; /* [count], copied */
    int32_t sweeps;    /* 10; with contact, contact's */
} tm_ties_def;

/* Why a tie is gone, besides the number of the instrument that cut it. */
enum { TM_TIE_BROKE = -1, TM_TIE_TISSUE_WENT = -2 };

/* Leads a tie from a vertex to the nearest point, at rest, of `triangle` [3*count] that does not belong to the vertex:
 * sets its ends, its weights and rest_m, their distance. Returns false if there is none. */
TM_API bool tm_tie_lead(const tm_mesh *mesh, int32_t vertex, const int32_t *triangle, int32_t count, tm_tie *tie);
TM_API tm_ties_def tm_ties_def_default(void);
TM_API tm_status tm_stage_ties(tm_world *world, const tm_ties_def *def, tm_ties **ties, tm_error *error);
/* Returns the world's stage "ties", or null. */
TM_API tm_ties *tm_world_ties(tm_world *world);
TM_API int32_t tm_ties_count(const tm_ties *ties);
/* Returns a tie as it was added. */
TM_API tm_tie tm_ties_get(const tm_ties *ties, int32_t tie);
TM_API bool tm_ties_is_whole(const tm_ties *ties, int32_t tie);
/* Returns the force of a tie in the last substep, N, and its ends [3] m (may be null). */
TM_API double tm_ties_force_N(const tm_ties *ties, int32_t tie, double from_m[3], double to_m[3]);
/* Writes up to `capacity` of the ties that went since the last call, in the order in which they went: which, and the
 * instrument that cut it or why (may be null). Returns their number; the others come with the next call. */
TM_API int32_t tm_ties_fetch_cut(tm_ties *ties, int32_t *tie, int32_t *why, int32_t capacity);

#ifdef __cplusplus
}
#endif
#endif
