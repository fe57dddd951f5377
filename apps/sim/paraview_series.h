/* A run as a time series for ParaView: FOLDER/run.pvd names one FOLDER/frame_NNNNNN.vtu a frame, with its simulated
 * time. Volume at rest, displacement, region, what is alive; tips and forces of the instruments. */
#ifndef TM_SIM_SERIES_H
#define TM_SIM_SERIES_H

#include "run.h"

typedef struct run_series {
    const char *folder; /* null: no series, and nothing happens */
    int64_t every, frames, written;
    uint8_t *condensed; /* [tet_count] not in the world's tissue, and alive all the same; null: none */
    app_file index;
    bool failed; /* told already; nothing more is written */
} run_series;

/* Makes the folder (its parent must be there) and writes the state before the first frame. 0 or an exit code. */
int run_series_begin(run_series *series, const sim *s, const char *folder, int64_t every);
/* After a frame. */
void run_series_add(run_series *series, const sim *s);
/* The index, with what was written; after a failure that was told: APP_FAILED. */
int run_series_end(run_series *series, bool good);

#endif
