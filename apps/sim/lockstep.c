/* tm-sim --lockstep: simulation, controllers and virtual devices on one virtual clock in one thread. Runs the code of
 * real time and gives the same bits every time. */
#include <cjson/cJSON.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "control_loops.h"
#include "io/histogram.h"
#include "json_file.h"
#include "observe.h"
#include "paraview_series.h"
#include "publish.h"
#include "run.h"
#include "scene/snapshot.h"
#include "statistics.h"
#include "stream.h"
#include "tools.h"

enum { START_US = 1000000, SESSION = 1, MAX_COUNT = 1024 };

typedef struct lockstep {
    sim *s;
    const run_options *o;
    const sim_haptics *haptics; /* null: the hand prescribes the instruments */
    app_queue *queue;           /* with haptics: messages between simulation and controllers */
    sim_control_loops loops;
    sim_tools tools;
    sim_publisher publisher;
    app_file csv, samples, report;
    run_series series;
    sim_stream stream;
    int64_t tick_us, ticks, frame, first_frame; /* first_frame: not 0 after --restore */
    int64_t sample;                             /* base samples since time 0 */
    double compute_s, processor_s, frame_s, second_s,
        busiest_s;        /* processor time; frame_s: of this frame; second_s: of this second */
    int64_t second_frame; /* first frame of this second */
    int64_t over;         /* frames that took longer than they last, by the wall clock */
    double noted_s;       /* compute_s at the end of the last frame */
    hrt_histogram frame_processor, frame_compute;
    sim_magnitude force;
    int joint_columns; /* of the trace: those of the device that all have, else the maximum of all devices */
} lockstep;

static int64_t sample_us(const lockstep *l, int64_t sample) {
    return START_US + llround((double)sample * l->s->sample_s * 1e6);
}

/* --- controllers and devices --- */

static void hear_tool(void *user, int instrument, const tensormass_tool_state_t *tool) {
    lockstep *l = user;
    sim_tools_take(&l->tools, instrument, app_link_now_us(l->publisher.link), tool);
}

static void hear_controller(void *user, int instrument, const tensormass_controller_status_t *status) {
    (void)user, (void)instrument, (void)status; /* called for the log */
}

/* Writes the header: joints by name if all instruments have the same ones, else by number. */
static void trace_header(lockstep *l, FILE *out) {
    const hrt_device_type *device = sim_same_devices(l->s) ? l->s->axes[0].device : NULL;
    l->joint_columns = device ? device->joints : SIM_JOINTS;
    fputs("time_s,instrument,state,fault,limits,px_m,py_m,pz_m,fx_N,fy_N,fz_N", out);
    for (int j = 0; j < l->joint_columns; j++)
        if (device)
            fprintf(out, ",%s", device->joint[j].name);
        else
            fprintf(out, ",joint_%d", j);
    fputs(",age_s\n", out);
}

static void trace_tick(lockstep *l, int i, int64_t now_us) {
    const sim_control_loop *t = &l->loops.loop[i];
    const hrt_result *h = &t->node.result;
    fprintf(l->csv.stream, "%.6f,%d,%d,%d,%" PRIu32, (double)(now_us - START_US) * 1e-6, i, h->state, h->fault,
            h->limits);
    for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", t->tool.tip_m[a]);
    for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", (double)h->force_N[a]);
    for (int j = 0; j < l->joint_columns; j++) fprintf(l->csv.stream, ",%.9g", t->tool.joint[j]);
    fprintf(l->csv.stream, ",%.6f\n", (double)h->sample_age_us * 1e-6);
}

static void tick(lockstep *l, int64_t now_us) {
    app_queue_set_clock(l->queue, now_us);
    for (int i = 0; i < l->s->instrument_count; i++) {
        sim_control_loop *t = &l->loops.loop[i];
        sim_control_loop_tick(t, now_us);
        app_link_receive(l->publisher.link, 0, MAX_COUNT);
        const float *f = t->node.result.force_N;
        sim_magnitude_add(&l->force, (const double[3]){(double)f[0], (double)f[1], (double)f[2]});
        if (l->csv.begun) trace_tick(l, i, now_us);
    }
    l->ticks++;
}

/* --- frames --- */

static void trace_sample(lockstep *l, const tensormass_force_sample_t *m, int64_t now_us) {
    const tm_tool_reaction *r = &l->s->reaction[m->instrument];
    if (l->samples.begun) {
        FILE *out = l->samples.stream;
        fprintf(out, "%" PRId64 ",%.6f,%d,%.6f", l->frame + 1, (double)(now_us - START_US) * 1e-6, m->instrument,
                (double)(m->tool_utime ? m->tool_utime - START_US : 0) * 1e-6);
        for (int a = 0; a < 3; a++) fprintf(out, ",%.9g", m->tip_m[a]);
        for (int a = 0; a < 3; a++) fprintf(out, ",%.9g", m->force_N[a]);
        for (int a = 0; a < 3; a++) fprintf(out, ",%.9g", r->resultant_N[a]);
        fprintf(out, ",%d,%d,%d", r->row_count, m->flags, m->stiffness_kind);
        for (int a = 0; a < 9; a++) fprintf(out, ",%.9g", m->stiffness_N_m[a]);
        fputc('\n', out);
    }
    if (!l->haptics) {
        sim_magnitude_add(&l->force, r->force_N);
        if (l->csv.begun) {
            fprintf(l->csv.stream, "%.6f,%d,-1,0,0", (double)(now_us - START_US) * 1e-6, m->instrument);
            for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", m->tip_m[a]);
            for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", m->force_N[a]);
            for (int j = 0; j < l->joint_columns; j++) fputs(",0", l->csv.stream);
            fputs(",0\n", l->csv.stream);
        }
    }
}

/* Returns this process's processor time, which other load on the machine does not change. */
static double processor_s(void) { return app_clock_s(CLOCK_PROCESS_CPUTIME_ID); }

/* Adds a complete frame to the account and updates the busiest simulated second. */
static void note_frame(lockstep *l) {
    if ((double)(l->frame - l->second_frame) * l->s->frame_s >= 1) l->second_s = 0, l->second_frame = l->frame;
    l->processor_s += l->frame_s;
    l->second_s += l->frame_s;
    l->busiest_s = fmax(l->busiest_s, l->second_s);
    hrt_histogram_add(&l->frame_processor, (int64_t)(1e9 * l->frame_s));
    hrt_histogram_add(&l->frame_compute, (int64_t)(1e9 * (l->compute_s - l->noted_s)));
    l->over += l->compute_s - l->noted_s > l->s->frame_s;
    l->noted_s = l->compute_s;
    l->frame_s = 0;
}

static tm_status sample(lockstep *l, int64_t now_us) {
    sim *s = l->s;
    tm_tool_pose to[TM_MAX_INSTRUMENTS];
    const sim_sends most = sim_stream_sends(s, sim_stream_rate_Hz(&l->stream));
    for (int i = 0; i < s->instrument_count; i++) {
        s->wants[i] = sim_tools_want(&l->tools, i);
        if (s->wants[i] > most) s->wants[i] = most;
        if (l->haptics)
            to[i] = sim_tools_target(&l->tools, i);
        else
            to[i] = sim_hand_pose(s, i, (double)(now_us - START_US) * 1e-6);
    }
    int64_t before = app_monotonic_us();
    const double processor_before_s = processor_s();
    const int32_t substeps = s->substeps / s->samples;
    tm_status status = sim_sample(s, to, substeps);
    l->frame_s += processor_s() - processor_before_s;
    l->compute_s += (double)(app_monotonic_us() - before) * 1e-6;
    if (s->broken_off) return status;
    l->sample++;
    if (l->queue) app_queue_set_clock(l->queue, now_us);
    for (int i = 0; i < s->instrument_count; i++) {
        tensormass_force_sample_t message;
        sim_publish_reaction(&l->publisher, s, &l->tools, i, now_us, substeps, s->average, 0, &message);
        trace_sample(l, &message, now_us);
    }
    return status;
}

/* Ends a frame after its last sample, or after the one that failed. */
static void end_frame(lockstep *l, int64_t now_us, tm_status status) {
    sim *s = l->s;
    const int64_t before = app_monotonic_us();
    const double processor_before_s = processor_s();
    if (!status) sim_frame_end(s);
    l->frame_s += processor_s() - processor_before_s;
    l->compute_s += (double)(app_monotonic_us() - before) * 1e-6;
    note_frame(l);
    l->frame++;
    sim_reach_note(s);
    if (l->frame % 10 == 9) sim_shape_note(s);
    /* The clock of this run is virtual, and so is the reported cost: a log must not depend on the machine. */
    sim_publish_frame(&l->publisher, s, now_us, 0, 0, sim_stream_rate_Hz(&l->stream));
    if (!status) run_series_add(&l->series, s);
}

/* --- the run --- */

static int64_t frame_total(const lockstep *l) {
    if (l->o->frames >= 0) return l->o->frames;
    double duration = l->o->duration_s >= 0 ? l->o->duration_s : l->s->scene->duration.si;
    return llround(duration / l->s->frame_s);
}

/* Time for which controllers run on after a frame that failed: the hand is still connected. */
enum { AFTERWARDS_US = 500000 };

static int loop(lockstep *l) {
    int64_t total = frame_total(l), now_us = START_US;
    int64_t snapshot_frame = l->o->snapshot ? llround(l->o->snapshot_s / l->s->frame_s) : -1;
    tm_status status = TM_OK;
    for (; l->frame < total && !status && !l->series.failed && !app_interrupted();) {
        /* A sample between two ticks precedes the later one; at equal times the tick is first. */
        const int64_t end_us = sample_us(l, l->sample + 1);
        if (l->haptics && now_us <= end_us) {
            tick(l, now_us);
            now_us += l->tick_us;
            continue;
        }
        status = sample(l, end_us);
        if (l->s->broken_off || (!status && l->sample % l->s->samples)) continue;
        end_frame(l, end_us, status);
        if (!status && l->frame == snapshot_frame) {
            int rc = app_exit_code(sim_snapshot_save(l->s, l->o->snapshot));
            if (rc) return rc;
        }
        app_progress("lockstep", (double)l->frame / (double)total, false);
    }
    app_progress("lockstep", 1, true);
    if (!status) return l->series.failed ? APP_FAILED : 0;
    for (int64_t end_us = now_us + AFTERWARDS_US; l->haptics && now_us < end_us; now_us += l->tick_us) tick(l, now_us);
    return run_unstable(l->frame);
}

static void report_controllers(lockstep *l, cJSON *json) {
    cJSON *list = cJSON_AddArrayToObject(json, "controllers");
    for (int i = 0; l->haptics && i < l->s->instrument_count; i++) {
        tensormass_controller_status_t h;
        hrt_node_status(&l->loops.loop[i].node, &h);
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "state", hrt_state_name((hrt_state)h.state));
        cJSON_AddStringToObject(row, "fault", h.fault_text);
        cJSON_AddStringToObject(row, "extrapolator", h.extrapolator);
        cJSON_AddNumberToObject(row, "samples_received", (double)h.samples_received);
        cJSON_AddNumberToObject(row, "samples_late", (double)h.samples_late);
        cJSON_AddNumberToObject(row, "samples_lost", (double)h.samples_lost);
        cJSON_AddNumberToObject(row, "samples_superseded", (double)l->loops.loop[i].node.superseded);
        cJSON_AddNumberToObject(row, "samples_rejected", (double)h.samples_rejected);
        cJSON_AddNumberToObject(row, "tools_rejected",
                                (double)(l->tools.tool[i].rejected + l->tools.tool[i].foreign + l->tools.tool[i].late));
    }
}

static void report(lockstep *l, cJSON *json, double wall_s) {
    char hash[20];
    sim *s = l->s;
    snprintf(hash, sizeof hash, "%016" PRIx64, sim_hash(s));
    double simulated_s = (double)(l->frame - l->first_frame) * s->frame_s;
    cJSON_AddNumberToObject(json, "frames", (double)(l->frame - l->first_frame));
    cJSON_AddBoolToObject(json, "interrupted", app_interrupted() != 0);
    cJSON_AddNumberToObject(json, "sim_s", simulated_s);
    cJSON_AddNumberToObject(json, "compute_s", l->compute_s);
    cJSON_AddNumberToObject(json, "wall_s", wall_s);
    cJSON_AddNumberToObject(json, "processor_s", l->processor_s);
    cJSON_AddNumberToObject(json, "busiest_second_s", l->busiest_s);
    hrt_report_quantiles(json, "frame_processor_us", &l->frame_processor);
    hrt_report_quantiles(json, "frame_compute_us", &l->frame_compute);
    cJSON_AddNumberToObject(json, "frames_over", (double)l->over);
    cJSON_AddNumberToObject(json, "sim_seconds_per_wall_second", l->compute_s > 0 ? simulated_s / l->compute_s : 0);
    cJSON_AddNumberToObject(json, "ticks", (double)l->ticks);
    cJSON_AddNumberToObject(json, "missed_ticks", 0); /* a virtual clock misses no tick */
    static const hrt_histogram none;
    hrt_report_quantiles(json, "lateness_us", &none);
    sim_report_magnitude(json, "force_N", &l->force);
    cJSON_AddNumberToObject(json, "tets_alive", sim_alive(s));
    cJSON_AddNumberToObject(json, "tets_removed", (double)s->cuts.total);
    cJSON_AddStringToObject(json, "state_hash", hash);
    run_report_coverage(s, json);
    run_report_ties(s, json);
    run_report_touch(s, json, false);
    run_report_energy(s, json);
    run_report_adaptive(s, json);
    report_controllers(l, json);
    if (app_is_quiet()) return;
    printf("%" PRId64 " frames, %.3g s simulated, %.2f simulated s per s of computing; %" PRId64
           " ticks; force %.3g N RMS, %.3g N peak; state %s\n",
           l->frame, simulated_s, l->compute_s > 0 ? simulated_s / l->compute_s : 0, l->ticks,
           sim_magnitude_rms(&l->force), l->force.peak, hash);
    run_print_ties(s);
}

static int begin(lockstep *l, const char *log) {
    sim *s = l->s;
    int rc = app_file_begin(&l->csv, l->o->csv);
    if (!rc) rc = app_file_begin(&l->samples, l->o->samples);
    if (!rc) rc = app_file_begin(&l->report, l->o->json);
    l->haptics = sim_options(s->scene, "haptics");
    if (l->haptics) l->queue = app_queue_create(START_US);
    const sim_way way = {
        .queue = l->queue, .log = log, .session = SESSION, .forces = true, .listener = {hear_tool, hear_controller, l}};
    if (!rc && l->haptics && !l->queue) rc = APP_FAILED;
    if (!rc) rc = sim_publisher_open(&l->publisher, s, &way);
    if (!rc && l->haptics && (l->o->restore || l->o->snapshot))
        rc = app_exit_code(app_scene_bad(
            s->scene, l->haptics->here.line,
            "a snapshot does not contain controllers; add --unset haptics, so that instruments follow the hand"));
    if (!rc && l->o->restore) rc = app_exit_code(sim_snapshot_restore(s, l->o->restore));
    if (!rc) rc = run_series_begin(&l->series, s, l->o->paraview, l->o->paraview_every);
    l->frame = l->first_frame = s->frames;
    l->sample = l->frame * s->samples;
    sim_stream_begin(&l->stream, s, 0);
    if (l->csv.begun) trace_header(l, l->csv.stream);
    if (l->samples.begun)
        fputs("frame,time_s,instrument,tn_s,px_m,py_m,pz_m,fx_N,fy_N,fz_N,rx_N,ry_N,rz_N,rows,flags,stiffness_kind,k11,"
              "k12,k13,k21,k22,k23,k31,k32,k33\n",
              l->samples.stream);
    l->tools.s = s;
    if (rc || !l->haptics) return rc;
    l->tick_us = llround(1e6 / l->haptics->tick_rate.si);
    return sim_control_loops_open(&l->loops, s, l->haptics, l->tick_us, l->queue);
}

int run_lockstep(sim *s, const run_options *o) {
    static lockstep state; /* too large for a stack, with its loopback bus */
    lockstep *l = &state;
    *l = (lockstep){.s = s, .o = o};
    tm_error error = {0};
    app_output log = {0};
    const sim_recording *recording = sim_options(s->scene, "recording");
    int rc = 0;
    if (recording && !app_output_begin(&log, recording->file.s, &error))
        return app_exit_code(sim_report(s->scene, recording->file.line, &error));
    int64_t start = app_monotonic_us();
    rc = begin(l, recording ? log.temporary : NULL);
    cJSON *json = run_report_begin(s, "lockstep");
    if (!rc) rc = loop(l);
    if (!sim_publisher_close(&l->publisher) && !rc) {
        fprintf(stderr, "%s: the log could not be written; the disk may be full\n", log.path);
        rc = APP_FAILED;
    }
    bool evidence = rc == RUN_UNSTABLE;
    if (evidence) rc = APP_FAILED;
    if (recording && rc && !evidence)
        app_output_abandon(&log);
    else if (recording && !app_output_commit(&log, &error))
        rc = app_report(NULL, 0, &error);
    if (!rc) sim_reach_report(s, (double)l->frame * s->frame_s);
    if (!rc) {
        sim_shape_note(s);
        sim_shape_report(s, json);
    }
    if (!rc) report(l, json, (double)(app_monotonic_us() - start) * 1e-6);
    int rc2 = app_file_end(&l->csv, !rc || evidence), rc3 = app_file_end(&l->samples, !rc || evidence);
    int rc4 = run_series_end(&l->series, true);
    if (rc) {
        app_file_end(&l->report, false);
        cJSON_Delete(json);
    } else
        rc = app_file_end_json(&l->report, json);
    sim_control_loops_close(&l->loops);
    app_queue_destroy(l->queue);
    rc = rc ? rc : rc2 ? rc2 : rc3 ? rc3 : rc4;
    return rc ? rc : run_say_interrupted(l->frame, frame_total(l));
}
