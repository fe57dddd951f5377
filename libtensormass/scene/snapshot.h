/* A cut, pressed, moving tissue in a file, to go on from with the same bits. */
#ifndef TM_SIM_SNAPSHOT_H
#define TM_SIM_SNAPSHOT_H

#include "sim.h"

/* 0 or a status, having complained. The file appears whole or not at all. */
tm_status sim_snapshot_save(sim *s, const char *path);
/* For the same scene. A damaged, foreign or truncated file is refused and the simulation left as it was. */
tm_status sim_snapshot_restore(sim *s, const char *path);

#endif
