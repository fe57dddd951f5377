/* Selective mass scaling: what a step asks vertices to weigh. */
#ifndef TM_SCALED_H
#define TM_SCALED_H

#include "tissue/tissue_internal.h"

/* Fills tissue->asked_kg for tissue->scaled_step_s; before assembly, whatever lives. False: no memory. */
bool tm_scaled_ask(tm_tissue *tissue);
/* After assembly: TM_ERR_LIMIT, naming the vertex that was added most to, above `most_share`. */
tm_status tm_scaled_check(const tm_tissue *tissue, double most_share, tm_error *error);

#endif
