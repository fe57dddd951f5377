/* How many force samples a frame has, and what may go with one. */
#ifndef TM_SIM_SAMPLE_RATE_H
#define TM_SIM_SAMPLE_RATE_H

#include "sim.h"

/* Who asks for forces; app_scene.pace. */
typedef enum sim_scene_pace {
    SIM_FRAMES = 0, /* the caller, once a frame */
    SIM_LOCKSTEP,   /* controllers on a virtual clock */
    SIM_REALTIME    /* controllers on the wall clock */
} sim_scene_pace;

/* Base samples of a frame that a scene asks for. */
int32_t sim_stream_per_frame(const app_scene *scene);

/* What may go with a force sample at a rate: a patch or stiffness costs more than a newer force where samples come so
 * often, unless the scene names `haptics.sends`. */
sim_sends sim_stream_sends(const sim *s, double rate_Hz);
/* The same where the scene does not name it. */
sim_sends sim_stream_sends_by_rate(double rate_Hz);

#endif
