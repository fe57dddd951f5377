/* Rate of the force samples: their number per frame, and the adaptation of the rate to the machine in real time. It
 * reads no clock: the caller measures.
 *
 * A frame (picture, log) is divided into base samples of equal substeps, as many as `haptics.rate` requires. A force
 * sample spans a batch of them, so a change of rate changes no substep. */
#ifndef TM_SIM_STREAM_H
#define TM_SIM_STREAM_H

#include "scene/sim.h"

typedef struct sim_stream {
    int32_t per_frame; /* base samples per frame */
    int32_t batch;     /* base samples per force sample, a divisor of per_frame */
    bool adapts;       /* the batch follows the costs */
    double frame_s;
    /* Smoothed costs, s: simulating a base sample; a force sample in addition; its patches, if its rate includes them;
     * a frame in addition to its samples. */
    double base_cost_s, sample_cost_s, patch_cost_s, frame_cost_s;
    double calm_s;  /* time for which a higher rate would have been possible, s */
    int32_t strain; /* successive frames that missed the present rate */
} sim_stream;

/* Time spent on a frame. */
typedef struct sim_stream_spent {
    double bases_s, samples_s, patches_s, frame_s;
    int32_t bases, samples, patches;
    bool dropped; /* simulated time was dropped */
} sim_stream_spent;

/* Chooses the first batch if the rate is `auto`. base_cost_s is measured before the first frame. */
void sim_stream_begin(sim_stream *stream, const sim *s, double base_cost_s);
/* Adapts the rate after each frame. Returns true if it changed. */
bool sim_stream_adapt(sim_stream *stream, const sim_stream_spent *spent);
double sim_stream_rate_Hz(const sim_stream *stream);
/* Returns the expected share of a processor with a batch. */
double sim_stream_load(const sim_stream *stream, int32_t batch);

#endif
