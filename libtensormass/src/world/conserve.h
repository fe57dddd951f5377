/* Energy conservation of corotated tissue (conserve.c). */
#ifndef TM_CONSERVE_H
#define TM_CONSERVE_H

#include "world/viscosity.h"

/* Allocates from the pool. Returns false without memory. */
bool tm_conserve_init(tm_conserving *c, tm_pool *pool, const tm_world *world, tm_rotation *rotation);
/* Sets a part of now_N to zero. */
void tm_conserve_clear(tm_conserving *c, int32_t part, int32_t parts);
/* Adds now_N to the world's force, and a force that removes the energy that the last step generated. batch_J holds the
 * energies of the listed batches. */
void tm_conserve(tm_conserving *c, tm_world *world);
/* The same for a world with averaged dilatation, including its force. */
void tm_conserve_whole(tm_conserving *c, tm_world *world);

/* Restarts after a cut or a change of the step. */
void tm_conserve_restart(tm_conserving *c);
/* Callbacks of tm_stage. */
int64_t tm_conserve_snapshot(const tm_conserving *c, void *buffer);
bool tm_conserve_restore(tm_conserving *c, const void *buffer, int64_t bytes, bool apply);
void tm_conserve_checkpoint(tm_conserving *c);
void tm_conserve_rollback(tm_conserving *c);

#endif
