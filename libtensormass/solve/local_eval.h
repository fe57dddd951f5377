/* Between local.c, newton.c and secant.c. */
#ifndef TMS_LOCAL_EVAL_H
#define TMS_LOCAL_EVAL_H

#include "local.h"

/* out [3*high] := displacements by forces on `slot`, given by slot or in the list's order. */
void tms_local_response(const tms_local *local, const int32_t *slot, int32_t count, const double *f, bool by_slot,
                        double *out);
/* u at the slots from base and forces. */
void tms_local_shape(tms_local *local);
/* Rows of the shape in u_m, their forces on the slots and on the tools. */
void tms_local_look(tms_local *local, tms_look *look);
/* Both, and the residual r: the sum of squares of the displacements it would make. Sets `converged`. */
double tms_local_evaluate(tms_local *local);
/* Known part of the matrix at the present rows, over act, factorised; `without`: a tool that is left out, -1. False:
 * singular. */
bool tms_local_factor(tms_local *local, int32_t without);
/* Displacement that the residual of the j-th unknown would make, per unit: the norm that residuals are compared in. */
double tms_local_scale(const tms_local *local, int32_t j);
/* secant.c: steps until converged or stalled; returns how many. */
int32_t tms_local_secant(tms_local *local, double *merit);

#endif
