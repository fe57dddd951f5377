/* Force of condensed tissue on its interface, at a cost below the square of the interface's size.
 *
 * S = K - C: the interface's own stiffness K is sparse; C >= 0, the compliance of the interior, is dense. C is split
 * into W W^T, of low rank, and a rest R. Every `every` substeps the full force F = -S r is computed, at the shape r
 * midway between the last two. In between, F - (K - W W^T) (u - r) follows the displacement since then. W is made by
 * Nystroem's formula, so 0 <= W W^T <= C:
 * - K - W W^T is between S and K, so the element bound of the step holds;
 * - the leapfrog's own energy is ((u - u_prev) / dt)^T (M - dt^2 (K - W W^T) / 4) ((u - u_prev) / dt) / 2 plus the
 * elastic energy of the model with S at the midway shape. Each full computation removes d^T R d / 2, where d is the
 * motion of the midway shape since the last one; nothing adds energy (with u itself fast modes would gain);
 * - at equilibrium u = r, and the force is that of S to the last bit. (Seven of eight full computations add S times the
 * change of r, with S in single: half the memory traffic. The eighth uses r itself, in double.)
 * W contains the softest modes of the interface, so R does not damp them. */
#ifndef TMS_COUPLING_H
#define TMS_COUPLING_H

#include "internal.h"

typedef struct tms_coupling {
    int32_t n, padded, rank, every;
    const double *schur;        /* upper triangle by rows */
    float *single;              /* the same in single, for changes of the full force, if the interface is followed */
    const double *prescribed_N; /* [n] force of the interior's loads and supports with the interface at 0 */
    int32_t *begin, *neighbour;
    /* K by 3x3 blocks, in pairs: a column of four numbers of each block, then the next column. Rows of interface vertex
     * v: begin[v].., an even number; the last block may be empty. */
    float *block;
    float *smooth;                  /* W by columns [rank][padded] */
    float *shape;                   /* [n][rank] orthonormal modes that W was made of */
    float *along;                   /* [rank] */
    float *moved, *answer;          /* [padded]; answer has one more */
    float *spread;                  /* [4*(n/3)] moved, padded to four numbers per vertex */
    double *whole_m, *whole_N;      /* [n] shape of the last full computation, and its F */
    double *change_m;               /* [n] change of that shape since the previous one */
    double *saved_m, *saved_N;      /* [n] checkpoint of a step */
    int32_t age, saved_age;         /* substeps since then; -1: never */
    int32_t changes, saved_changes; /* updates of F in single since it was computed in double */
    int64_t bytes;
    void *history;
} tms_coupling;

/* Keeps pointers to `schur` and `given_N`. `border`: [n] components 3*vertex + axis, ascending, three per vertex. */
tm_status tms_coupling_create(const tm_tissue *condensed, const int32_t *interface, int32_t n, const double *schur,
                              const double *given_N, tms_coupling *coupling, tm_error *error);
void tms_coupling_destroy(tms_coupling *coupling);
/* force_N := force of the condensed part on its interface at the displacement u_m, a step after u_prev_m, all [n].
 * Counts substeps. */
void tms_coupling_force(tms_coupling *coupling, const double *u_m, const double *u_prev_m, double *force_N);
/* Computes the energy whose gradient is this substep's force: steady_N - (K - W W^T) u. Returns its value at u = 0, J.
 * Loads and supports of the interior are included in both. */
double tms_coupling_steady(tms_coupling *coupling, double *steady_N);
/* Makes the next force a full computation. */
void tms_coupling_forget(tms_coupling *coupling);
void tms_coupling_checkpoint(tms_coupling *coupling);
void tms_coupling_rollback(tms_coupling *coupling);
/* State as a stage's hooks require: returns the bytes, and writes them unless `buffer` is null; returns false if the
 * buffer is invalid. */
int64_t tms_coupling_snapshot(const tms_coupling *coupling, void *buffer);
bool tms_coupling_restore(tms_coupling *coupling, const void *buffer, int64_t bytes, bool apply);

/* coupling_kernel.c: the inner loops; bit-identical on all machines. */
/* force := given - schur * at; reads each entry of the triangle once. */
void tms_whole_force(const double *schur, const double *given, const double *at, int32_t n, double *force);
/* force -= schur * moved, with its copy in single. */
void tms_whole_change(const float *single, const double *moved, int32_t n, double *force);
/* answer := (K - W W^T) moved, [padded] */
void tms_follow(tms_coupling *coupling);

#endif
