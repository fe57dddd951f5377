/* State of a session on the wall clock, shared by its loop and its report. */
#ifndef TM_SIM_REALTIME_H
#define TM_SIM_REALTIME_H

#include <cjson/cJSON.h>

#include "io/histogram.h"
#include "paraview_series.h"
#include "publish.h"
#include "run.h"
#include "statistics.h"
#include "stream.h"
#include "tools.h"

typedef struct controller_seen {
    bool seen;
    int64_t ticks, missed;
    double lateness_us[4];
} controller_seen;

typedef struct realtime {
    sim *s;
    const run_options *o;
    const sim_haptics *haptics; /* null: the hand prescribes the instruments */
    sim_publisher publisher;
    sim_tools tools;
    app_file samples_file, report;
    run_series series;
    controller_seen controller[TM_MAX_INSTRUMENTS];
    sim_stream stream;
    sim_stream_spent spent;                          /* time spent on the current frame */
    int64_t start_us, next_us, frame_us, frame;      /* next_us: end of the current frame */
    int64_t overruns, samples, merged, rate_changes; /* merged: base samples too late for a force sample of their own */
    double simulated_s, compute_s, cost_s;           /* cost_s: smoothed cost of one substep */
    hrt_histogram lateness, compute, sample_lateness;
    sim_magnitude force;
    bool reported_waiting;
    struct told {
        bool here, gone;
        int64_t refused_us, refused; /* time of the last message about refused tool states; number since */
    } told[TM_MAX_INSTRUMENTS];
    sim_refused thrown_away; /* numbers at the last report */
    int64_t reported_dropped_us;
} realtime;

/* Fills the report of a session that has ended and prints its summary line. */
void realtime_report(realtime *r, cJSON *json);

#endif
