/* tm-sim --realtime: frames on the wall clock; tools and forces over LCM. */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "json_file.h"
#include "log_line.h"
#include "observe.h"
#include "realtime.h"
#include "scene/snapshot.h"

/* A single lost or late message is not reported; a longer time without accepted messages is. */
static const int64_t worth_a_line_us = 100000, line_every_us = 1000000;

static void report_refusals(struct told *told, const sim_tool *tool, int64_t now_us, const tensormass_tool_state_t *m,
                            int instrument, const char *why) {
    told->refused++;
    bool other = !tool->seen || m->session != tool->now.session;
    if ((!other && now_us - tool->gate.heard_us < worth_a_line_us) ||
        (told->refused_us && now_us - told->refused_us < line_every_us))
        return;
    app_say("tm-sim: refused %" PRId64 " of TOOL_%d, the last of session %" PRId64 ": %s", told->refused, instrument,
            m->session, why);
    told->refused_us = now_us;
    told->refused = 0;
}

static void take_tool(void *user, int instrument, const tensormass_tool_state_t *message) {
    realtime *r = user;
    const sim_tool *tool = &r->tools.tool[instrument];
    struct told *told = &r->told[instrument];
    int64_t before = tool->now.session, now_us = app_monotonic_us();
    const char *why = sim_tools_take(&r->tools, instrument, now_us, message);
    if (why)
        report_refusals(told, tool, now_us, message, instrument, why);
    else if (!told->here)
        app_remark("tm-sim: controller of instrument %d is connected\n", instrument);
    else if (message->session != before)
        app_say("tm-sim: a new controller of instrument %d is connected (session %" PRId64 " after %" PRId64 ")",
                instrument, message->session, before);
    else if (told->gone)
        app_say("tm-sim: controller of instrument %d sends again", instrument);
    if (why) return;
    told->here = true;
    told->gone = false;
}

static void report_gone(realtime *r) {
    for (int i = 0; i < r->s->instrument_count; i++) {
        struct told *told = &r->told[i];
        if (!told->here || told->gone || app_monotonic_us() - r->tools.tool[i].gate.heard_us < HRT_GATE_SILENCE_US)
            continue;
        app_say("tm-sim: controller of instrument %d stopped sending; its tool keeps its last pose", i);
        told->gone = true;
    }
}

/* Reports, at most once a second, messages that never reached take_tool. */
static void report_dropped(realtime *r) {
    const sim_refused now = sim_publisher_refused(&r->publisher), *old = &r->thrown_away;
    int64_t now_us = app_monotonic_us();
    if (!memcmp(&now, old, sizeof now) || now_us - r->reported_dropped_us < line_every_us) return;
    app_say("tm-sim: refused since the last such message: %" PRId64 " incomplete messages, %" PRId64
            " without the key's tag or for another simulation, %" PRId64 " packets of other programs, %" PRId64
            " of other machines",
            now.malformed - old->malformed, now.forged - old->forged, now.packets - old->packets,
            now.foreign - old->foreign);
    r->thrown_away = now;
    r->reported_dropped_us = now_us;
}

static void take_status(void *user, int instrument, const tensormass_controller_status_t *message) {
    controller_seen *c = &((realtime *)user)->controller[instrument];
    c->seen = true;
    c->ticks = message->ticks;
    c->missed = message->missed_ticks;
    memcpy(c->lateness_us, message->lateness_us, sizeof c->lateness_us);
}

/* Further messages wait for the next frame. */
enum { FLOOD = 1024 };

static void wait_until(realtime *r, int64_t deadline_us) {
    for (;;) {
        int64_t left = deadline_us - app_monotonic_us();
        if (left <= 0 || app_interrupted()) break;
        if (r->haptics)
            app_link_receive(r->publisher.link, left, FLOOD);
        else {
            struct timespec t = {deadline_us / 1000000, deadline_us % 1000000 * 1000};
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        }
    }
    if (r->haptics) app_link_receive(r->publisher.link, 0, FLOOD);
}

/* Returns the number of substeps that fit into the time of `bases`, by recent costs. Excess simulated time is dropped,
 * never caught up. */
static int32_t affordable(const realtime *r, int32_t bases) {
    const int32_t substeps = bases * (r->s->substeps / r->s->samples);
    if (r->cost_s <= 0) return substeps;
    double can = 0.95 * bases * r->s->sample_s / r->cost_s;
    if (can >= substeps) return substeps;
    return can < 1 ? 1 : (int32_t)can;
}

static double seconds_since(int64_t begin_us) { return (double)(app_monotonic_us() - begin_us) * 1e-6; }

static void publish_sample(realtime *r, int32_t substeps, bool dropped) {
    sim *s = r->s;
    int32_t average = s->average < substeps ? s->average : substeps;
    for (int i = 0; i < s->instrument_count; i++) {
        tensormass_force_sample_t sample;
        sim_publish_reaction(&r->publisher, s, &r->tools, i, app_clock_us(CLOCK_REALTIME), substeps, average,
                             dropped ? SIM_FLAG_OVERRAN : 0, &sample);
        sim_magnitude_add(&r->force, sample.force_N);
        if (!r->samples_file.begun) continue;
        FILE *out = r->samples_file.stream;
        fprintf(out, "%" PRId64 ",%.6f,%d,%" PRId64, r->frame + 1, seconds_since(r->start_us), i, sample.tool_utime);
        for (int a = 0; a < 3; a++) fprintf(out, ",%.9g", sample.tip_m[a]);
        for (int a = 0; a < 3; a++) fprintf(out, ",%.9g", sample.force_N[a]);
        fprintf(out, ",%d,%d\n", s->reaction[i].row_count, sample.flags);
    }
}

/* Simulates `bases` base samples up to the newest poses and sends the instruments' forces. */
static tm_status one_sample(realtime *r, int32_t bases) {
    sim *s = r->s;
    tm_tool_pose to[TM_MAX_INSTRUMENTS];
    const int64_t begin = app_monotonic_us();
    const sim_sends most = sim_stream_sends(s, sim_stream_rate_Hz(&r->stream));
    for (int i = 0; i < s->instrument_count; i++) {
        s->wants[i] = sim_tools_want(&r->tools, i);
        if (s->wants[i] > most) s->wants[i] = most;
        if (r->haptics)
            to[i] = sim_tools_target(&r->tools, i);
        else
            to[i] = sim_hand_pose(s, i, (double)(begin - r->start_us) * 1e-6);
    }
    const int32_t substeps = affordable(r, bases), asked = bases * (s->substeps / s->samples);
    const tm_status status = sim_sample(s, to, substeps);
    const double stepped_s = seconds_since(begin) - s->patches_s, cost = stepped_s / substeps;
    r->cost_s = r->cost_s > 0 ? r->cost_s + 0.2 * bases / s->samples * (cost - r->cost_s) : cost;
    if (s->broken_off) return status;
    r->simulated_s += substeps * s->dt_s;
    r->samples++;
    r->merged += bases > r->stream.batch ? bases - r->stream.batch : 0;
    publish_sample(r, substeps, substeps < asked);
    r->spent.bases += bases, r->spent.samples++, r->spent.patches += most == SIM_SENDS_PATCH;
    r->spent.bases_s += stepped_s, r->spent.patches_s += s->patches_s;
    r->spent.samples_s += seconds_since(begin) - stepped_s - s->patches_s;
    r->publisher.dropped_us += llround((asked - substeps) * s->dt_s * 1e6);
    r->spent.dropped |= substeps < asked;
    return status;
}

/* Returns the base samples that are due: a batch, or more if the wall clock has advanced, at most to the frame's
 * end. */
static int32_t due(const realtime *r, int32_t done, int64_t now_us) {
    const int32_t left = r->s->samples - done;
    const int64_t begin_us = r->next_us - r->frame_us;
    int32_t bases = (int32_t)((double)(now_us - begin_us) * r->s->samples / (double)r->frame_us + 1e-6) - done;
    if (bases < r->stream.batch) bases = r->stream.batch;
    return bases < left ? bases : left;
}

/* Does the work once per frame, after its last sample: status, picture, time of the next frame. */
static void end_frame(realtime *r, tm_status status) {
    sim *s = r->s;
    const int64_t begin = app_monotonic_us();
    double spent_s = r->spent.bases_s + r->spent.patches_s + r->spent.samples_s;
    if (!status) sim_frame_end(s);
    r->frame++;
    r->compute_s += spent_s;
    hrt_histogram_add(&r->compute, (int64_t)(spent_s * 1e9));
    const double wall_s = seconds_since(r->start_us);
    sim_publish_frame(&r->publisher, s, app_clock_us(CLOCK_REALTIME), spent_s, wall_s > 0 ? r->simulated_s / wall_s : 0,
                      sim_stream_rate_Hz(&r->stream));
    if (r->frame % 10 == 0) {
        sim_reach_note(s);
        sim_shape_note(s);
    }
    if (!status) run_series_add(&r->series, s); /* an error was reported; the session continues */
    r->spent.frame_s = seconds_since(begin);
    r->next_us += r->frame_us;
    const int64_t now = app_monotonic_us();
    if (now > r->next_us) { /* never catches up by more than one frame: the schedule restarts here */
        r->publisher.dropped_us += now - r->next_us;
        r->next_us = now;
        r->spent.dropped = true;
    }
    r->overruns += r->spent.dropped;
    r->rate_changes += sim_stream_adapt(&r->stream, &r->spent);
    r->spent = (sim_stream_spent){0};
}

static tm_status one_frame(realtime *r) {
    const double base_us = (double)r->frame_us / r->s->samples;
    tm_status status = TM_OK;
    for (int32_t done = 0; done < r->s->samples && !status;) {
        const int64_t due_us = r->next_us - r->frame_us + llround((done + r->stream.batch) * base_us);
        wait_until(r, due_us);
        if (app_interrupted()) return status;
        const int64_t now_us = app_monotonic_us();
        const int32_t bases = due(r, done, now_us);
        hrt_histogram_add(&r->sample_lateness, 1000 * (now_us - due_us));
        if (done + bases == r->s->samples) hrt_histogram_add(&r->lateness, 1000 * (now_us - r->next_us));
        status = one_sample(r, bases);
        if (r->s->broken_off) return status;
        done += bases;
    }
    end_frame(r, status);
    return status;
}

/* Measures the cost of a substep before the first frame: three frames of one substep each. */
static tm_status calibrate(realtime *r) {
    tm_status status = TM_OK;
    for (int i = 0; i < 3 && !status; i++) {
        int64_t begin = app_monotonic_us();
        status = sim_frame(r->s, r->s->pose, 1);
        double spent_s = (double)(app_monotonic_us() - begin) * 1e-6;
        r->cost_s = i ? fmin(r->cost_s, spent_s) : spent_s;
        r->simulated_s += r->s->dt_s;
    }
    return status;
}

static int64_t frame_total(const realtime *r) {
    double duration = r->o->duration_s;
    return r->o->frames >= 0 ? r->o->frames : duration >= 0 ? llround(duration / r->s->frame_s) : INT64_MAX;
}

static int loop(realtime *r) {
    double duration = r->o->duration_s; /* no duration: until Ctrl-C */
    int64_t total = frame_total(r);
    tm_status status = calibrate(r);
    sim_stream_begin(&r->stream, r->s, r->cost_s * (r->s->substeps / r->s->samples));
    r->frame_us = llround(r->s->frame_s * 1e6);
    r->start_us = app_monotonic_us();
    r->next_us = r->start_us + r->frame_us;
    while (!status && !app_interrupted()) {
        if (r->frame >= total || (duration >= 0 && app_monotonic_us() - r->start_us > llround(duration * 1e6))) break;
        status = one_frame(r);
        report_gone(r);
        if (r->haptics) report_dropped(r);
        if (r->haptics && !r->reported_waiting && r->frame * r->frame_us > 1000000) {
            for (int i = 0; i < r->s->instrument_count; i++)
                if (!r->tools.tool[i].seen) app_say("tm-sim: waiting for TOOL_%d; start haptic-rt, in any order", i);
            r->reported_waiting = true;
        }
    }
    return status ? run_unstable(r->frame) : 0;
}

static int begin(realtime *r, const char *log) {
    sim *s = r->s;
    int rc = app_file_begin(&r->samples_file, r->o->samples);
    if (!rc) rc = app_file_begin(&r->report, r->o->json);
    r->haptics = sim_options(s->scene, "haptics");
    bool network = r->haptics || sim_has(s, "rendering");
    const char *url = r->o->url ? r->o->url : getenv("LCM_DEFAULT_URL");
    if (!url || !*url) url = "udpm://239.255.76.67:7667?ttl=0";
    app_key key = {.known = false};
    char why[300];
    if (!rc && r->haptics && !app_key_for(url, r->o->key, r->o->no_key, &key, why, sizeof why))
        rc = app_bad_input("--key", 0, "%s", why);
    const sim_way way = {.url = network ? url : NULL,
                         .log = log,
                         .key = &key,
                         .session = app_session(),
                         .forces = r->haptics != NULL,
                         .listener = {r->haptics ? take_tool : NULL, take_status, r}};
    if (!rc) rc = sim_publisher_open(&r->publisher, s, &way);
    r->tools.s = s;
    if (!rc && r->o->restore) rc = app_exit_code(sim_snapshot_restore(s, r->o->restore));
    if (!rc) rc = run_series_begin(&r->series, s, r->o->paraview, r->o->paraview_every);
    if (r->samples_file.begun)
        fputs("frame,time_s,instrument,tn_us,px_m,py_m,pz_m,fx_N,fy_N,fz_N,rows,flags\n", r->samples_file.stream);
    return rc;
}

int run_realtime(sim *s, const run_options *o) {
    realtime r = {.s = s, .o = o};
    tm_error error = {0};
    app_output log = {0};
    if (o->csv)
        return app_bad_input(
            "--csv", 0,
            "--csv writes controller ticks only with --lockstep; use --samples, or record and read CONTROLLER_0");
    const sim_recording *recording = sim_options(s->scene, "recording");
    if (recording && !app_output_begin(&log, recording->file.s, &error))
        return app_exit_code(sim_report(s->scene, recording->file.line, &error));
    int rc = begin(&r, recording ? log.temporary : NULL);
    cJSON *json = run_report_begin(s, "realtime");
    if (!rc && tm_model_start(s->model, &error)) rc = app_exit_code(sim_report(s->scene, 0, &error));
    if (!rc) rc = loop(&r);
    if (r.haptics) r.thrown_away = sim_publisher_refused(&r.publisher);
    if (!sim_publisher_close(&r.publisher) && !rc) {
        fprintf(stderr, "%s: the log could not be written; the disk may be full\n", log.path);
        rc = APP_FAILED;
    }
    bool evidence = rc == RUN_UNSTABLE;
    if (evidence) rc = APP_FAILED;
    if (recording && rc && !evidence)
        app_output_abandon(&log);
    else if (recording && !app_output_commit(&log, &error))
        rc = app_report(NULL, 0, &error);
    if (!rc) sim_reach_report(s, r.simulated_s);
    if (!rc) {
        sim_shape_note(s);
        sim_shape_report(s, json);
    }
    if (!rc) realtime_report(&r, json);
    int rc2 = app_file_end(&r.samples_file, !rc || evidence);
    int rc3 = run_series_end(&r.series, true);
    if (rc) {
        app_file_end(&r.report, false);
        cJSON_Delete(json);
    } else
        rc = app_file_end_json(&r.report, json);
    rc = rc ? rc : rc2 ? rc2 : rc3;
    return rc ? rc : run_say_interrupted(r.frame, frame_total(&r));
}
