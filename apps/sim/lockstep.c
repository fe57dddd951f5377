/* tm-sim --lockstep: simulation, controllers and virtual devices on one virtual clock, in one thread. The same code as
 * in real time, the same bits every time. */
#include <cjson/cJSON.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "device/device.h"
#include "figures.h"
#include "io/node.h"
#include "io/profile.h"
#include "publish.h"
#include "run.h"
#include "series.h"
#include "snapshot.h"
#include "surface.h"
#include "tools.h"

enum { QUEUE = 512, START_US = 1000000, SESSION = 1 };

typedef struct sent {
    int64_t due_us;
    tensormass_force_sample_t sample;
    tensormass_contact_patch_t *patch; /* null: none; ours to free */
} sent;

typedef struct station {
    hrt_node node;
    hrt_device device;
    hrt_bus node_bus, device_bus;
    hrt_tool_state tool;
    sent queue[QUEUE];
    uint32_t head, tail;
} station;

typedef struct lockstep {
    sim *s;
    const run_options *o;
    const sim_haptics *haptics; /* null: instruments follow the hand */
    station *station;           /* [instrument_count], with haptics */
    hrt_loopback bus;
    sim_tools tools;
    sim_publisher publisher;
    run_file csv, samples, report;
    run_series series;
    int64_t tick_us, ticks, frame, first_frame; /* first: not 0 after --restore */
    uint64_t random;
    double compute_s;
    sim_magnitude force;
} lockstep;

static double next_random(lockstep *l) {
    uint64_t z = l->random += 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static int64_t frame_us(const lockstep *l, int64_t frame) {
    return START_US + llround((double)frame * l->s->frame_s * 1e6);
}

/* --- controllers and devices --- */

static int make_station(lockstep *l, int i) {
    sim *s = l->s;
    station *t = &l->station[i];
    const app_instrument *scene = (const app_instrument *)s->scene->instrument.item + i;
    hrt_device_config device = hrt_device_config_default(i);
    hrt_node_config node = hrt_node_config_default(i);
    if (l->haptics->profile.line && !hrt_profile_read(l->haptics->profile.s, &device.profile)) return APP_BAD_INPUT;
    node.params = device.profile;
    node.mode = (int8_t)s->instrument_def[i].mode;
    node.session = SESSION;
    node.pose_known = true;
    memcpy(node.pose.trocar_m, scene->trocar.v, sizeof node.pose.trocar_m);
    memcpy(node.pose.axis, scene->axis.v, sizeof node.pose.axis);
    memcpy(node.pose.up, scene->up.v, sizeof node.pose.up);
    node.extrapolator = (hrt_extrapolator)l->haptics->extrapolator.index;
    node.passivity = l->haptics->passivity.on;
    node.enable = true;
    device.session = 1;
    device.seed = (uint64_t)l->haptics->seed.value;
    device.period_us = (double)l->tick_us;
    for (int j = 0; j < SIM_JOINTS; j++) device.rest[j] = s->start_joint[i][j];
    device.hand = s->hand[i];
    hrt_bus_open_loopback(&t->device_bus, &l->bus);
    hrt_bus_open_loopback(&t->node_bus, &l->bus);
    hrt_device_init(&t->device, &device, &t->device_bus);
    hrt_node_init(&t->node, &node, &t->node_bus);
    return 0;
}

static void tool_message(const hrt_tool_state *from, tensormass_tool_state_t *to) {
    *to = (tensormass_tool_state_t){.utime = from->utime,
                                    .seq = (int32_t)from->seq,
                                    .session = from->session,
                                    .instrument = from->instrument,
                                    .mode = from->mode,
                                    .state = from->state,
                                    .active = from->active,
                                    .extrapolator = from->extrapolator};
    memcpy(to->tip_m, from->tip_m, sizeof to->tip_m);
    memcpy(to->joint, from->joint, sizeof to->joint);
}

static void force_message(const tensormass_force_sample_t *from, hrt_force_sample *to) {
    *to = (hrt_force_sample){.utime = from->utime,
                             .session = from->session,
                             .tool_session = from->tool_session,
                             .tool_utime = from->tool_utime,
                             .seq = (uint32_t)from->seq,
                             .instrument = from->instrument,
                             .stiffness_kind = from->stiffness_kind,
                             .flags = from->flags,
                             .topology_revision = from->topology_revision};
    memcpy(to->tip_m, from->tip_m, sizeof to->tip_m);
    memcpy(to->force_N, from->force_N, sizeof to->force_N);
    memcpy(to->stiffness_N_m, from->stiffness_N_m, sizeof to->stiffness_N_m);
}

static void send_status(lockstep *l, int i, int64_t now_us, int32_t seq) {
    hrt_status h = {0};
    char channel[24];
    hrt_node_status(&l->station[i].node, &h);
    tensormass_controller_status_t m = {.utime = now_us,
                                        .seq = seq,
                                        .session = h.session,
                                        .instrument = (int8_t)i,
                                        .state = (int8_t)h.state,
                                        .fault = h.fault,
                                        .fault_text = (char *)(uintptr_t)(h.fault_text ? h.fault_text : ""),
                                        .limits = h.limits,
                                        .extrapolator =
                                            (char *)(uintptr_t)hrt_extrapolator_name((hrt_extrapolator)h.extrapolator),
                                        .passivity_on = (int8_t)h.passivity_on,
                                        .passivity_J = h.passivity_J,
                                        .sample_age_s = h.sample_age_s,
                                        .ticks = h.ticks,
                                        .missed_ticks = h.missed_ticks,
                                        .samples_received = h.samples_received,
                                        .samples_late = h.samples_late,
                                        .samples_lost = h.samples_lost,
                                        .samples_rejected = h.samples_rejected,
                                        .can_tx = h.can_tx,
                                        .can_rx = h.can_rx,
                                        .can_errors = h.can_errors};
    memcpy(m.force_N, h.force_N, sizeof m.force_N);
    snprintf(channel, sizeof channel, "CONTROLLER_%d", i);
    l->publisher.api->send(l->publisher.link, SIM_CONTROLLER, channel, now_us, &m);
}

static void trace_tick(lockstep *l, int i, int64_t now_us) {
    const station *t = &l->station[i];
    const hrt_output *h = &t->node.output;
    fprintf(l->csv.stream, "%.6f,%d,%d,%d,%" PRIu32, (double)(now_us - START_US) * 1e-6, i, h->state, h->fault,
            h->limits);
    for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", t->tool.tip_m[a]);
    for (int a = 0; a < 3; a++) fprintf(l->csv.stream, ",%.9g", (double)h->force_N[a]);
    for (int j = 0; j < SIM_JOINTS; j++) fprintf(l->csv.stream, ",%.9g", t->tool.joint[j]);
    fprintf(l->csv.stream, ",%.6f\n", (double)h->sample_age_us * 1e-6);
}

/* A patch comes before the sample with the same seq. */
static void deliver(station *t, sent *s) {
    hrt_force_sample sample;
    tensormass_contact_patch_t *p = s->patch;
    if (p) {
        hrt_patch_message m = {.session = p->session,
                               .seq = (uint32_t)p->seq,
                               .instrument = p->instrument,
                               .topology_revision = p->topology_revision,
                               .vertex_count = p->vertex_count,
                               .triangle_count = p->triangle_count,
                               .vertex_m = p->vertex_m,
                               .rest_m = p->rest_m,
                               .origin_m = p->origin_m,
                               .face = p->face,
                               .triangle = p->triangle,
                               .compliance_m_N = p->compliance_m_N,
                               .skin_compliance_m_N = p->skin_compliance_m_N,
                               .force_cap_N = p->force_cap_N,
                               .radius_m = p->radius_m,
                               .contact_length_m = p->contact_length_m,
                               .film_s_m = p->film_s_m,
                               .held = p->held,
                               .hold_N = p->hold_N};
        hrt_node_post_patch(&t->node, &m);
        free(p);
    }
    force_message(&s->sample, &sample);
    hrt_node_post_sample(&t->node, &sample);
}

static void tick(lockstep *l, int64_t now_us) {
    for (int i = 0; i < l->s->instrument_count; i++) {
        station *t = &l->station[i];
        for (; t->head != t->tail && t->queue[t->head % QUEUE].due_us <= now_us; t->head++)
            deliver(t, &t->queue[t->head % QUEUE]);
        hrt_device_step(&t->device, now_us);
        hrt_node_tick(&t->node, now_us, &t->tool);
        double force[3] = {(double)t->node.output.force_N[0], (double)t->node.output.force_N[1],
                           (double)t->node.output.force_N[2]};
        sim_magnitude_add(&l->force, force);
        tensormass_tool_state_t m;
        char channel[16];
        tool_message(&t->tool, &m);
        sim_tools_take(&l->tools, i, now_us, &m);
        snprintf(channel, sizeof channel, "TOOL_%d", i);
        if (l->publisher.api) l->publisher.api->send(l->publisher.link, SIM_TOOL, channel, now_us, &m);
        if (l->publisher.api && (now_us - START_US) % 100000 < l->tick_us)
            send_status(l, i, now_us, (int32_t)((now_us - START_US) / 100000));
        if (l->csv.begun) trace_tick(l, i, now_us);
    }
    l->ticks++;
}

/* --- frames --- */

static void trace_frame(lockstep *l, const tensormass_force_sample_t *m, int64_t now_us) {
    const tm_tool_reaction *r = &l->s->reaction[m->instrument];
    if (l->samples.begun) {
        FILE *out = l->samples.stream;
        fprintf(out, "%" PRId64 ",%.6f,%d,%.6f", l->frame, (double)(now_us - START_US) * 1e-6, m->instrument,
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
            fprintf(l->csv.stream, ",0,0,0,0,0,0\n");
        }
    }
}

/* Takes the patch over. */
static void queue_sample(lockstep *l, int i, int64_t now_us, const tensormass_force_sample_t *sample,
                         tensormass_contact_patch_t *patch) {
    station *t = &l->station[i];
    double late_s = l->haptics->latency.si * l->s->frame_s + next_random(l) * l->haptics->jitter.si;
    bool lost = next_random(l) < l->haptics->loss.si;
    if (lost || t->tail - t->head == QUEUE) {
        free(patch);
        return;
    }
    int64_t due = now_us + llround(late_s * 1e6);
    /* One wire: what is sent later does not arrive earlier. */
    if (t->tail != t->head && t->queue[(t->tail - 1) % QUEUE].due_us > due)
        due = t->queue[(t->tail - 1) % QUEUE].due_us;
    t->queue[t->tail++ % QUEUE] = (sent){due, *sample, patch};
}

static tm_status frame(lockstep *l, int64_t now_us) {
    sim *s = l->s;
    tm_tool_pose to[TM_MAX_INSTRUMENTS];
    for (int i = 0; i < s->instrument_count; i++) {
        s->wants[i] = sim_tools_want(&l->tools, i);
        if (l->haptics)
            to[i] = sim_tools_target(&l->tools, i);
        else
            to[i] = sim_hand_pose(s, i, (double)(now_us - START_US) * 1e-6);
    }
    int64_t before = app_monotonic_us();
    tm_status status = sim_frame(s, to, s->substeps);
    double spent_s = (double)(app_monotonic_us() - before) * 1e-6;
    l->compute_s += spent_s;
    if (s->broken_off) {
        l->frame--;
        return status;
    }
    for (int i = 0; i < s->instrument_count; i++) {
        const sim_tool *tool = &l->tools.tool[i];
        int64_t t_n = sim_tools_mean_utime(&l->tools, i, s->substeps, s->average);
        tensormass_force_sample_t sample;
        sim_force_sample(&l->publisher, s, i, now_us, t_n ? tool->now.session : 0, t_n, 0, &sample);
        tensormass_contact_patch_t *patch = s->patch_valid[i] ? malloc(sizeof *patch) : NULL;
        if (patch && sim_contact_patch(&l->publisher, s, &sample, patch))
            sim_publish_patch(&l->publisher, now_us, patch);
        sim_publish_force(&l->publisher, now_us, &sample);
        trace_frame(l, &sample, now_us);
        if (l->haptics)
            queue_sample(l, i, now_us, &sample, patch);
        else
            free(patch);
    }
    sim_reach_note(s);
    /* The clock of this run is virtual, so is the cost that it reports: a log must not depend on the machine. */
    sim_publish_frame(&l->publisher, s, now_us, 0, 0);
    if (!status) run_series_add(&l->series, s);
    return status;
}

/* --- the run --- */

static int64_t frame_total(const lockstep *l) {
    if (l->o->frames >= 0) return l->o->frames;
    double duration = l->o->duration_s >= 0 ? l->o->duration_s : l->s->scene->duration.si;
    return llround(duration / l->s->frame_s);
}

/* Ticks of the controllers go on for so long after a frame that failed: the hand is still there. */
enum { AFTERWARDS_US = 500000 };

static int loop(lockstep *l) {
    int64_t total = frame_total(l), now_us = START_US;
    int64_t snapshot_frame = l->o->snapshot ? llround(l->o->snapshot_s / l->s->frame_s) : -1;
    tm_status status = TM_OK;
    for (; l->frame < total && !status && !l->series.failed && !app_interrupted();) {
        /* A frame between two ticks comes before the later one; at the same time the tick comes first. */
        bool ticking = l->haptics && now_us <= frame_us(l, l->frame + 1);
        if (ticking) {
            tick(l, now_us);
            now_us += l->tick_us;
            continue;
        }
        l->frame++;
        status = frame(l, frame_us(l, l->frame));
        if (!status && !l->s->broken_off && l->frame == snapshot_frame) {
            int rc = sim_snapshot_save(l->s, l->o->snapshot);
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
        hrt_status h = {0};
        hrt_node_status(&l->station[i].node, &h);
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "state", hrt_state_name((hrt_state)h.state));
        cJSON_AddStringToObject(row, "fault", h.fault_text ? h.fault_text : "");
        cJSON_AddStringToObject(row, "extrapolator", hrt_extrapolator_name((hrt_extrapolator)h.extrapolator));
        cJSON_AddNumberToObject(row, "samples_received", (double)h.samples_received);
        cJSON_AddNumberToObject(row, "samples_late", (double)h.samples_late);
        cJSON_AddNumberToObject(row, "samples_lost", (double)h.samples_lost);
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
    cJSON_AddNumberToObject(json, "sim_seconds_per_wall_second", l->compute_s > 0 ? simulated_s / l->compute_s : 0);
    cJSON_AddNumberToObject(json, "ticks", (double)l->ticks);
    cJSON_AddNumberToObject(json, "missed_ticks", 0); /* a virtual clock misses none */
    sim_quantiles none = {0};
    sim_report_quantiles(json, "lateness_us", &none);
    sim_report_magnitude(json, "force_N", &l->force);
    cJSON_AddNumberToObject(json, "tets_alive", sim_alive(s));
    cJSON_AddNumberToObject(json, "tets_removed", (double)s->cuts.total);
    cJSON_AddStringToObject(json, "state_hash", hash);
    run_report_energy(s, json);
    report_controllers(l, json);
    if (app_is_quiet()) return;
    printf("%" PRId64 " frames, %.3g s simulated, %.2f simulated s per s of computing; %" PRId64
           " ticks; force %.3g N RMS, %.3g N peak; state %s\n",
           l->frame, simulated_s, l->compute_s > 0 ? simulated_s / l->compute_s : 0, l->ticks,
           sim_magnitude_rms(&l->force), l->force.peak, hash);
}

static int begin(lockstep *l, const char *log) {
    sim *s = l->s;
    int rc = run_file_begin(&l->csv, l->o->csv);
    if (!rc) rc = run_file_begin(&l->samples, l->o->samples);
    if (!rc) rc = run_file_begin(&l->report, l->o->json);
    if (!rc) rc = sim_publisher_open(&l->publisher, s, NULL, log, &(app_key){.known = false}, SESSION);
    l->haptics = sim_options(s->scene, "haptics");
    if (!rc && l->haptics && (l->o->restore || l->o->snapshot))
        rc = app_scene_bad(s->scene, l->haptics->here.line,
                           "a snapshot holds the simulation, not its controllers; add --unset haptics, so that "
                           "instruments follow the hand");
    if (!rc && l->o->restore) rc = sim_snapshot_restore(s, l->o->restore);
    if (!rc) rc = run_series_begin(&l->series, s, l->o->paraview, l->o->paraview_every);
    l->frame = l->first_frame = s->frames;
    if (l->csv.begun)
        fputs("time_s,instrument,state,fault,limits,px_m,py_m,pz_m,fx_N,fy_N,fz_N," HRT_ENGINE_COLUMNS ",age_s\n",
              l->csv.stream);
    if (l->samples.begun)
        fputs("frame,time_s,instrument,tn_s,px_m,py_m,pz_m,fx_N,fy_N,fz_N,rx_N,ry_N,rz_N,rows,flags,stiffness_kind,k11,"
              "k12,k13,k21,k22,k23,k31,k32,k33\n",
              l->samples.stream);
    l->tools.s = s;
    if (rc || !l->haptics) return rc;
    l->tick_us = llround(1e6 / l->haptics->rate.si);
    l->random = (uint64_t)l->haptics->seed.value;
    hrt_loopback_init(&l->bus);
    l->station = calloc((size_t)s->instrument_count, sizeof *l->station);
    if (!l->station) return APP_FAILED;
    for (int i = 0; i < s->instrument_count && !rc; i++) rc = make_station(l, i);
    return rc;
}

int run_lockstep(sim *s, const run_options *o) {
    static lockstep state; /* with its loopback bus too large for a stack */
    lockstep *l = &state;
    *l = (lockstep){.s = s, .o = o};
    tm_error error = {0};
    app_output log = {0};
    const sim_recording *recording = sim_options(s->scene, "recording");
    int rc = 0;
    if (recording && !app_output_begin(&log, recording->file.s, &error))
        return sim_report(s->scene, recording->file.line, &error);
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
    if (!rc) report(l, json, (double)(app_monotonic_us() - start) * 1e-6);
    int rc2 = run_file_end(&l->csv, !rc || evidence), rc3 = run_file_end(&l->samples, !rc || evidence);
    int rc4 = run_series_end(&l->series, true);
    if (rc) {
        run_file_end(&l->report, false);
        cJSON_Delete(json);
    } else
        rc = run_report_end(json, &l->report);
    for (int i = 0; l->station && i < s->instrument_count; i++) {
        station *t = &l->station[i];
        for (; t->head != t->tail; t->head++) free(t->queue[t->head % QUEUE].patch);
        hrt_bus_close(&l->station[i].node_bus);
        hrt_bus_close(&l->station[i].device_bus);
    }
    free(l->station);
    rc = rc ? rc : rc2 ? rc2 : rc3 ? rc3 : rc4;
    return rc ? rc : run_say_interrupted(l->frame, frame_total(l));
}
