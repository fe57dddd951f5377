/* What condensed tissue does to its border, at a price that does not grow with the border's square.
 *
 * S = K - C: the border's own stiffness K is sparse; C >= 0, what the inside gives way, is dense. C is split into
 * W W^T, of low rank, and a rest R. Every `every` substeps the force F = -S r is computed whole, at the shape r midway
 * between the last two; in between it follows the displacement since then by F - (K - W W^T) (u - r). W is made by
 * Nystroem's formula, so 0 <= W W^T <= C:
 * - K - W W^T lies between S and K, and the element bound of the step holds;
 * - with the leapfrog's own energy, ((u - u_prev) / dt)^T (M - dt^2 (K - W W^T) / 4) ((u - u_prev) / dt) / 2 and the
 *   elastic one of the model with S at the midway shape, each whole computation takes d^T R d / 2 away, where d is
 *   what the midway shape has moved since the last one, and nothing adds any (the midway shape is what makes it so:
 *   with u itself quick shapes would gain);
 * - what rests has u = r: there it is S to the last bit. (Whole computations but each eighth add S times what r has
 *   moved since the one before, S in single: half the memory read. Each eighth is of r itself, in double.)
 * W holds the softest shapes of the border, which R therefore does not slow down. */
#ifndef TMS_COUPLING_H
#define TMS_COUPLING_H

#include "internal.h"

typedef struct tms_coupling {
    int32_t n, padded, rank, every;
    const double *schur;        /* upper triangle by rows */
    float *single;              /* the same, for changes of the whole force; of a border that is followed */
    const double *prescribed_N; /* [n] force of the inside's loads and supports with the border at 0 */
    int32_t *begin, *neighbour;
    /* K by 3x3 blocks, two at a time: a column of four numbers of each, then the next one; rows of border vertex v:
     * begin[v].. , an even number, the last of which may be empty. */
    float *block;
    float *smooth;                  /* W by columns [rank][padded] */
    float *shape;                   /* [n][rank] orthonormal shapes that W was made of */
    float *along;                   /* [rank] */
    float *moved, *answer;          /* [padded]; answer with one more */
    float *spread;                  /* [4*(n/3)] moved, a vertex in four numbers */
    double *whole_m, *whole_N;      /* [n] where F was computed whole, and F */
    double *change_m;               /* [n] what that shape has moved since the one before */
    double *saved_m, *saved_N;      /* [n] of a step that may be given back */
    int32_t age, saved_age;         /* substeps since; -1: never */
    int32_t changes, saved_changes; /* of F in single since it was computed in double */
    int64_t bytes;
    void *history;
} tms_coupling;

/* `schur` and `given_N` stay the caller's; `border`: [n] components 3*vertex + axis, ascending, whole vertices. */
tm_status tms_coupling_create(const tm_tissue *condensed, const int32_t *border, int32_t n, const double *schur,
                              const double *given_N, tms_coupling *coupling, tm_error *error);
void tms_coupling_destroy(tms_coupling *coupling);
/* force_N := that of the condensed part on its border at the displacement u_m, a step after u_prev_m, all [n]. Counts
 * substeps. */
void tms_coupling_force(tms_coupling *coupling, const double *u_m, const double *u_prev_m, double *force_N);
/* What the force of this substep is a gradient of: steady_N - (K - W W^T) u, of an energy that at u = 0 is returned, J;
 * with loads and supports of the inside left out of neither. */
double tms_coupling_steady(tms_coupling *coupling, double *steady_N);
/* The next force is computed whole. */
void tms_coupling_forget(tms_coupling *coupling);
void tms_coupling_checkpoint(tms_coupling *coupling);
void tms_coupling_rollback(tms_coupling *coupling);
/* State, as the hooks of a stage want it: bytes, or what is written; false: it cannot be one. */
int64_t tms_coupling_snapshot(const tms_coupling *coupling, void *buffer);
bool tms_coupling_restore(tms_coupling *coupling, const void *buffer, int64_t bytes, bool apply);

/* coupling_kernel.c: the inner loops; the same bits on every machine. */
/* force := given - schur * at, each entry of the triangle read once. */
void tms_whole_force(const double *schur, const double *given, const double *at, int32_t n, double *force);
/* force -= schur * moved, by its copy in single. */
void tms_whole_change(const float *single, const double *moved, int32_t n, double *force);
/* answer := (K - W W^T) moved, [padded] */
void tms_follow(tms_coupling *coupling);

#endif
