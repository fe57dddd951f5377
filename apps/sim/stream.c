#include "stream.h"

#include <math.h>

#include "scene/effects.h"

/* Shares of a processor: above the first the rate falls; it rises if the next higher rate stays below the second. The
 * rest is left to controllers and the system. */
static const double load_max = 0.8, load_raise = 0.65;
static const double calm_before_raise_s = 1;
enum { STRAIN_MAX = 3 };

static double rate_of(const sim_stream *stream, int32_t batch) { return stream->per_frame / (stream->frame_s * batch); }

double sim_stream_rate_Hz(const sim_stream *stream) { return rate_of(stream, stream->batch); }

double sim_stream_load(const sim_stream *stream, int32_t batch) {
    const int32_t samples = stream->per_frame / batch;
    double cost_s = stream->per_frame * stream->base_cost_s + samples * stream->sample_cost_s + stream->frame_cost_s;
    if (sim_stream_sends_by_rate(rate_of(stream, batch)) == SIM_SENDS_PATCH) cost_s += samples * stream->patch_cost_s;
    return cost_s / stream->frame_s;
}

/* Returns the next divisor of per_frame above (coarser) or below `batch`, or `batch` itself at the end. */
static int32_t neighbour(const sim_stream *stream, int32_t batch, bool coarser) {
    const int32_t step = coarser ? 1 : -1;
    for (int32_t b = batch + step; b >= 1 && b <= stream->per_frame; b += step)
        if (stream->per_frame % b == 0) return b;
    return batch;
}

/* Returns the highest rate within the load, or the rate of the lowest load if none is. */
static int32_t choose(const sim_stream *stream) {
    int32_t best = 1;
    for (int32_t batch = 1;; batch = neighbour(stream, batch, true)) {
        if (sim_stream_load(stream, batch) <= load_raise) return batch;
        if (sim_stream_load(stream, batch) < sim_stream_load(stream, best)) best = batch;
        if (batch == stream->per_frame) return best;
    }
}

void sim_stream_begin(sim_stream *stream, const sim *s, double base_cost_s) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    *stream = (sim_stream){.per_frame = s->samples,
                           .batch = 1,
                           .adapts = haptics && haptics->rate.si == 0 && s->scene->pace == SIM_REALTIME,
                           .frame_s = s->frame_s,
                           .base_cost_s = base_cost_s,
                           .sample_cost_s = 50e-6 * (1 + s->instrument_count)}; /* until it is measured */
    if (stream->adapts) stream->batch = choose(stream);
}

/* Returns a neighbour of the present batch that costs at least 5 % less, or the batch itself. If patches cost more than
 * the samples that they replace, that is the finer one. */
static int32_t cheaper(const sim_stream *stream) {
    const int32_t coarser = neighbour(stream, stream->batch, true), finer = neighbour(stream, stream->batch, false);
    const double least = 0.95 * sim_stream_load(stream, stream->batch);
    const double by_coarser = sim_stream_load(stream, coarser), by_finer = sim_stream_load(stream, finer);
    if (fmin(by_coarser, by_finer) >= least) return stream->batch;
    return by_coarser <= by_finer ? coarser : finer;
}

static void smooth(double *mean, double sum, int32_t count) {
    if (count > 0) *mean = *mean > 0 ? *mean + 0.1 * (sum / count - *mean) : sum / count;
}

bool sim_stream_adapt(sim_stream *stream, const sim_stream_spent *spent) {
    smooth(&stream->base_cost_s, spent->bases_s, spent->bases);
    smooth(&stream->sample_cost_s, spent->samples_s, spent->samples);
    smooth(&stream->patch_cost_s, spent->patches_s, spent->patches);
    smooth(&stream->frame_cost_s, spent->frame_s, 1);
    if (!stream->adapts) return false;
    const int32_t before = stream->batch, finer = neighbour(stream, before, false);
    const double load = sim_stream_load(stream, before);
    stream->strain = spent->dropped || load > load_max ? stream->strain + 1 : 0;
    stream->calm_s =
        !spent->dropped && sim_stream_load(stream, finer) <= load_raise ? stream->calm_s + stream->frame_s : 0;
    if (stream->strain >= STRAIN_MAX)
        stream->batch = cheaper(stream);
    else if (stream->calm_s >= calm_before_raise_s)
        stream->batch = finer;
    if (stream->batch == before) return false;
    stream->strain = 0;
    stream->calm_s = 0;
    return true;
}
