/* Report of tm-sim --realtime at the end of a session. */
#include "realtime.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

/* Reports frames and simulated time against the wall clock. */
static void report_rate(const realtime *r, double wall_s, cJSON *json) {
    cJSON *rate = cJSON_AddObjectToObject(json, "force_samples");
    cJSON_AddNumberToObject(rate, "count", (double)r->samples);
    cJSON_AddNumberToObject(rate, "rate_Hz", sim_stream_rate_Hz(&r->stream));
    cJSON_AddNumberToObject(rate, "mean_rate_Hz", wall_s > 0 ? (double)r->samples / wall_s : 0);
    cJSON_AddNumberToObject(rate, "changes", (double)r->rate_changes);
    cJSON_AddNumberToObject(rate, "merged", (double)r->merged);
}

/* Reports how many messages were refused, by reason. */
static void report_refused(const realtime *r, cJSON *json) {
    if (r->haptics) {
        cJSON *row = cJSON_AddObjectToObject(json, "refused");
        cJSON_AddNumberToObject(row, "malformed", (double)r->thrown_away.malformed);
        cJSON_AddNumberToObject(row, "forged", (double)r->thrown_away.forged);
        cJSON_AddNumberToObject(row, "packets", (double)r->thrown_away.packets);
        cJSON_AddNumberToObject(row, "foreign", (double)r->thrown_away.foreign);
    }
}

/* Reports each controller's samples and lateness. */
static void report_controllers(const realtime *r, cJSON *json) {
    int64_t ticks = 0, missed = 0;
    double late[4] = {0};
    cJSON *list = cJSON_AddArrayToObject(json, "tools");
    for (int i = 0; r->haptics && i < r->s->instrument_count; i++) {
        const sim_tool *t = &r->tools.tool[i];
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddNumberToObject(row, "accepted", (double)t->accepted);
        cJSON_AddNumberToObject(row, "late", (double)t->late);
        cJSON_AddNumberToObject(row, "foreign", (double)t->foreign);
        cJSON_AddNumberToObject(row, "rejected", (double)t->rejected);
        ticks += r->controller[i].ticks;
        missed += r->controller[i].missed;
        for (int k = 0; k < 4; k++) late[k] = fmax(late[k], r->controller[i].lateness_us[k]);
    }
    cJSON_AddNumberToObject(json, "ticks", (double)ticks);
    cJSON_AddNumberToObject(json, "missed_ticks", (double)missed);
    cJSON *row = cJSON_AddObjectToObject(json, "lateness_us"); /* the controllers' own statistics */
    cJSON_AddNumberToObject(row, "p50", late[0]);
    cJSON_AddNumberToObject(row, "p99", late[1]);
    cJSON_AddNumberToObject(row, "max", late[3]);
}

void realtime_report(realtime *r, cJSON *json) {
    char hash[20];
    double wall_s = (double)(app_monotonic_us() - r->start_us) * 1e-6;
    snprintf(hash, sizeof hash, "%016" PRIx64, sim_hash(r->s));
    cJSON_AddNumberToObject(json, "frames", (double)r->frame);
    cJSON_AddBoolToObject(json, "interrupted", app_interrupted() != 0);
    cJSON_AddNumberToObject(json, "sim_s", r->simulated_s);
    cJSON_AddNumberToObject(json, "wall_s", wall_s);
    cJSON_AddNumberToObject(json, "compute_s", r->compute_s);
    /* Relative to the clock while running: below 1 only if time was dropped. compute_s gives the machine's capacity. */
    cJSON_AddNumberToObject(json, "sim_seconds_per_wall_second", wall_s > 0 ? r->simulated_s / wall_s : 0);
    cJSON_AddNumberToObject(json, "sim_seconds_per_compute_second",
                            r->compute_s > 0 ? r->simulated_s / r->compute_s : 0);
    cJSON_AddNumberToObject(json, "overruns", (double)r->overruns);
    report_rate(r, wall_s, json);
    cJSON_AddNumberToObject(json, "dropped_s", (double)r->publisher.dropped_us * 1e-6);
    hrt_report_quantiles(json, "frame_lateness_us", &r->lateness);
    hrt_report_quantiles(json, "frame_compute_us", &r->compute);
    hrt_report_quantiles(json, "sample_lateness_us", &r->sample_lateness);
    sim_report_magnitude(json, "force_N", &r->force);
    cJSON_AddNumberToObject(json, "tets_alive", sim_alive(r->s));
    cJSON_AddStringToObject(json, "state_hash", hash);
    report_refused(r, json);
    run_report_coverage(r->s, json);
    run_report_ties(r->s, json);
    run_report_touch(r->s, json, false);
    run_report_energy(r->s, json);
    run_report_adaptive(r->s, json);
    report_controllers(r, json);
    if (app_is_quiet()) return;
    printf("%" PRId64 " frames in %.2f s, %.3f simulated s per s, %.3g force samples a second, %" PRId64
           " overruns, %.3g s dropped; force %.3g N RMS, %.3g N peak\n",
           r->frame, wall_s, wall_s > 0 ? r->simulated_s / wall_s : 0, wall_s > 0 ? (double)r->samples / wall_s : 0,
           r->overruns, (double)r->publisher.dropped_us * 1e-6, sim_magnitude_rms(&r->force), r->force.peak);
    run_print_ties(r->s);
}
