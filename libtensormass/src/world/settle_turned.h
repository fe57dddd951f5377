/* Between settle.c and Newton's method. */
#ifndef TM_SETTLE_TURNED_H
#define TM_SETTLE_TURNED_H

#include "tissue/tangent.h"
#include "world/settle_path.h"
#include "world/world_internal.h"

typedef struct tm_turned_rest {
    const uint8_t *held;      /* [3*vertex_count] prescribed, or without mass */
    const double *external_N; /* [3*vertex_count] */
    const double *target_m;   /* [3*vertex_count] where held components shall be */
    bool turns_only;          /* nothing is done where no support turns */
} tm_turned_rest;

/* From u_m, the state now, to the rest; on failure u_m is somewhere between. result: steps and residual. */
tm_status tm_settle_turned(const tm_world *world, const tm_turned_rest *rest, const tm_settle_def *def, double *u_m,
                           tm_settle_result *result, tm_error *error);

#endif
