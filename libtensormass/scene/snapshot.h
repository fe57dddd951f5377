/* A cut, pressed, moving tissue in a file, to go on from with the same bits. */
#ifndef TM_SIM_SNAPSHOT_H
#define TM_SIM_SNAPSHOT_H

#include "sim.h"

/* 0 or an exit code, having complained. The file appears whole or not at all. */
int sim_snapshot_save(sim *s, const char *path);
/* For the same scene. A damaged, foreign or truncated file is refused and the simulation left as it was. */
int sim_snapshot_restore(sim *s, const char *path);

#endif
