/* A frame by its force samples: `haptics.rate` divides it, and forces are compared at frames' ends. */
#include <math.h>
#include <string.h>

#include "study.h"

bool study_frame(sim *s, int k, const study_each *each, double *cost_s) {
    *cost_s = 0;
    for (int j = 0; j < s->samples; j++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const double time_s = (k * s->samples + j + 1) * s->sample_s;
        if (each->before) each->before(each->user, j);
        for (int i = 0; i < s->instrument_count; i++) to[i] = sim_hand_pose(s, i, time_s);
        const double before_s = study_cpu_s();
        if (sim_sample(s, to, s->substeps / s->samples) || s->broken_off) return false;
        if (each->after) each->after(each->user, s, j);
        if (j == s->samples - 1) sim_frame_end(s);
        *cost_s += study_cpu_s() - before_s;
    }
    return true;
}

/* A force is the mean of its last substeps: of a sample those of its end, of a frame with one sample more of them. */
double study_back(const sim *s) {
    const double frame_s = 0.5 * fmax(s->scene->average.si * s->frame_s - s->dt_s, 0),
                 sample_s = 0.5 * (s->average - 1) * s->dt_s;
    return s->samples > 1 ? fmax(frame_s - sample_s, 0) / s->sample_s : 0;
}

void study_at_frames(const double *samples_N, int frames, int samples, size_t width, double back, double *out_N) {
    for (int k = 0; k < frames; k++) {
        const double at = fmax((k + 1) * samples - 1 - back, 0);
        const size_t low = (size_t)floor(at);
        const double part = at - floor(at);
        for (size_t c = 0; c < width; c++) {
            const double *f = samples_N + low * width + c;
            out_N[(size_t)k * width + c] = part > 0 ? (1 - part) * f[0] + part * f[width] : f[0];
        }
    }
}
