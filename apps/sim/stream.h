/* Rate of the force samples: how many a frame has, and in real time how their rate follows what the machine can. Keeps
 * no clock: the caller measures.
 *
 * A frame (picture, log) is divided into base samples of equal substeps, as many as `haptics.rate` asks for. A force
 * sample spans a batch of them, so that a change of rate changes no substep. */
#ifndef TM_SIM_STREAM_H
#define TM_SIM_STREAM_H

#include "scene/sim.h"

typedef struct sim_stream {
    int32_t per_frame; /* base samples of a frame */
    int32_t batch;     /* base samples of a force sample, a divisor of per_frame */
    bool adapts;       /* the batch follows the costs */
    double frame_s;
    /* Smoothed costs, seconds: of simulating a base sample; of a force sample beside that; of its patches, where its
     * rate brings them; of a frame beside its samples. */
    double base_cost_s, sample_cost_s, patch_cost_s, frame_cost_s;
    double calm_s;  /* for how long a higher rate would have been held */
    int32_t strain; /* frames in a row in which the present one was not */
} sim_stream;

/* What a frame took. */
typedef struct sim_stream_spent {
    double bases_s, samples_s, patches_s, frame_s;
    int32_t bases, samples, patches;
    bool dropped; /* simulated time was dropped */
} sim_stream_spent;

/* base_cost_s: measured before the first frame; chooses the first batch where the rate is `auto`. */
void sim_stream_begin(sim_stream *stream, const sim *s, double base_cost_s);
/* After each frame. Returns true if the rate changed. */
bool sim_stream_adapt(sim_stream *stream, const sim_stream_spent *spent);
double sim_stream_rate_Hz(const sim_stream *stream);
/* Expected share of a processor at a batch. */
double sim_stream_load(const sim_stream *stream, int32_t batch);

#endif
