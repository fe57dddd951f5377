/* Tissue that turns keeps its energy (conserve.c). */
#ifndef TM_CONSERVE_H
#define TM_CONSERVE_H

#include "world/viscosity.h"

/* Room from the pool. False: no memory. */
bool tm_conserve_init(tm_conserving *c, tm_pool *pool, const tm_world *world, tm_rotation *rotation);
/* Adds now_N to the world's force, and what takes back the energy that the last step made. Energies of the listed packs
 * are in batch_J. */
void tm_conserve(tm_conserving *c, tm_world *world);
/* The same of a world whose changes of volume are averaged, with its force. */
void tm_conserve_whole(tm_conserving *c, tm_world *world);

/* The tissue was cut, or the step changed. */
void tm_conserve_restart(tm_conserving *c);
/* As tm_stage asks for them. */
int64_t tm_conserve_snapshot(const tm_conserving *c, void *buffer);
bool tm_conserve_restore(tm_conserving *c, const void *buffer, int64_t bytes, bool apply);
void tm_conserve_checkpoint(tm_conserving *c);
void tm_conserve_rollback(tm_conserving *c);

#endif
