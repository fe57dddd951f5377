/* Options of effects that the run modes read. */
#ifndef TM_SIM_EFFECTS_H
#define TM_SIM_EFFECTS_H

#include "scene.h"

typedef struct sim_haptics {
    app_section here;
    app_choice extrapolator; /* hrt_extrapolator */
    app_choice sends;        /* sim_sends; unset: depends on the extrapolator */
    app_choice compliance;   /* of patches of the dynamic model: factor, iterations */
    app_integer patch_vertices;
    app_number rate; /* rate of force samples; 0: auto */
    app_number tick_rate, latency, loss, jitter;
    app_flag passivity;
    app_text profile;
    app_integer seed;
} sim_haptics;

typedef struct sim_recording {
    app_section here;
    app_text file;
} sim_recording;

typedef struct sim_rendering {
    app_section here;
    app_integer every;
} sim_rendering;

#endif
