/* Between local.c, matrix.c and newton.c: each leans on those before it. */
#ifndef TMS_LOCAL_EVAL_H
#define TMS_LOCAL_EVAL_H

#include "local.h"

static inline const tms_pin *tms_pin_of(const tms_local *l, int32_t slot) { return &l->pin[l->pin_of[slot]]; }

static inline bool tms_is_pinned(const tms_local *l, int32_t slot, int axis) {
    const int64_t d = 3 * slot + axis;
    return l->pin_of[slot] >= 0 && !l->pin[l->pin_of[slot]].given &&
           l->block[d * 3 * l->capacity + d] > 0; /* a fixed component stays where it is */
}

/* A force that a spring bears at most keeps its size and turns with the spring: change of its component `c` for a
 * move of the vertex along axis `j`, N/m. */
static inline double tms_pin_turns(const tms_pin *pin, int c, int j) {
    const double along = pin->most_N > 0 ? pin->force_N[c] * pin->force_N[j] / (pin->most_N * pin->most_N) : 0;
    return pin->given ? -pin->turn_N_m * ((c == j) - along) : 0;
}

/* out [3*high] := displacements by forces on `slot`, given by slot or in the list's order. */
void tms_local_response(const tms_local *local, const int32_t *slot, int32_t count, const double *f, bool by_slot,
                        double *out);
/* u at the slots from base and forces. */
void tms_local_shape(tms_local *local);
/* Rows of the shape in u_m that are no farther off than `margin` radii, their forces on the slots and on the tools. */
void tms_local_look(tms_local *local, tms_look *look, double margin);
/* Those forces anew, of the rows as they stand. */
void tms_local_sum(const tms_local *local, tms_look *look);
/* Both, and the residual r: the sum of squares of the displacements it would make. Sets `converged`. */
double tms_local_evaluate(tms_local *local);
/* Known part of the matrix at the present rows, over act, factorised; `without`: a tool that is left out, -1. False:
 * singular. */
bool tms_local_factor(tms_local *local, int32_t without);
/* Displacement that the residual of the j-th unknown would make, per unit: the norm that residuals are compared in. */
double tms_local_scale(const tms_local *local, int32_t j);
/* rub.c: what friction adds to a look; to the matrix of the present one. */
void tms_local_rub(const tms_local *local, tms_look *look);
void tms_local_add_grip_matrix(tms_local *local, const tms_grip *grip, int32_t m);

#endif
