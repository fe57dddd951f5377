/* A run as a time series for ParaView: FOLDER/run.pvd lists one FOLDER/frame_NNNNNN.vtu per frame with its simulated
 * time. A frame has the undeformed volume, displacements, regions, active tetrahedra, and the instruments' tips and
 * forces. */
#ifndef TM_SIM_SERIES_H
#define TM_SIM_SERIES_H

#include "run.h"

typedef struct run_series {
    const char *folder; /* null: no series; all calls do nothing */
    int64_t every, frames, written;
    uint8_t *condensed; /* [tet_count] active, but not in the world's tissue; null: none */
    app_file index;
    bool failed; /* an error was reported; nothing more is written */
} run_series;

/* Makes the folder (its parent must exist) and writes the state before the first frame. Returns 0 or an exit code. */
int run_series_begin(run_series *series, const sim *s, const char *folder, int64_t every);
/* Writes the state after a frame. */
void run_series_add(run_series *series, const sim *s);
/* Writes the index of the frames. Returns APP_FAILED if an error was reported before. */
int run_series_end(run_series *series, bool good);

#endif
