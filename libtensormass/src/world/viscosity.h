/* What settling needs of the stage "viscosity". */
#ifndef TM_VISCOSITY_INTERNAL_H
#define TM_VISCOSITY_INTERNAL_H

#include "rotation/rotation_internal.h"
#include "tensormass/viscosity.h"
#include "world/world_internal.h"

enum { TM_COOKIE_VISCOSITY = 0x76697363 };

bool tm_stage_is_viscosity(const tm_stage *stage);

/* The history of a strain that runs straight from one step to the next, exactly: the integral of
 * exp(-(t_end - t)/time) s(t) dt/time is  keep * before + old * s_begin + new * s_end. */
typedef struct tm_fading {
    double keep, old, now;
} tm_fading;
tm_fading tm_fading_of(double dt_s, double time_s);

/* While a world settles: its tensors (and what turns) are those of tissue that has relaxed, and the stage is still.
 * Without the stage all three do nothing. */
typedef struct tm_relaxed {
    tm_tissue *tissue; /* null: nothing relaxes */
    tm_packs packs;
    tm_swollen swollen;
    tm_pool pool;
} tm_relaxed;
tm_status tm_relaxed_begin(tm_world *world, tm_relaxed *relaxed, tm_error *error);
/* `rests`: u is the rest, and so the history is that of having been there for ever. */
void tm_relaxed_end(tm_world *world, tm_relaxed *relaxed, bool rests);

#endif
