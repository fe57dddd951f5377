/* Saves a cut, pressed, moving tissue to a file; the restored run continues with the same bits. */
#ifndef TM_SIM_SNAPSHOT_H
#define TM_SIM_SNAPSHOT_H

#include "sim.h"

/* Returns 0, or a status after adding a fault. The file appears complete or not at all. */
tm_status sim_snapshot_save(sim *s, const char *path);
/* Restores into the same scene. A damaged, foreign or truncated file is refused; the simulation is then unchanged. */
tm_status sim_snapshot_restore(sim *s, const char *path);

#endif
