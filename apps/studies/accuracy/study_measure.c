/* Measures one setting of the scene along its hand's path: force per frame, shape at some moments, cost. A frame is run
 * sample by sample, as `haptics.rate` divides it; forces are compared at frames' ends. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bandwidth.h"
#include "common/program_host.h"
#include "scene/solve_api.h"
#include "sim/stream.h"
#include "study.h"

/* --- preparation of a run --- */

void study_set(study_run *r, const char *format, ...) {
    va_list list;
    if (r->set_count == STUDY_SETS) abort(); /* the tables below are shorter */
    va_start(list, format);
    if (vasprintf(&r->set[r->set_count++], format, list) < 0) abort();
    va_end(list);
}

study_run *study_add(study *t, const char *knob, const char *name) {
    if (t->run_count == STUDY_RUNS) abort();
    study_run *r = &t->run[t->run_count++];
    *r = (study_run){.force_error = NAN, .shape_error = NAN, .change = NAN, .peak_change = NAN};
    snprintf(r->knob, sizeof r->knob, "%s", knob);
    snprintf(r->name, sizeof r->name, "%s", name);
    for (int i = 0; i < t->set_count; i++) study_set(r, "%s", t->set[i]);
    r->edits_from = r->set_count;
    return r;
}

/* --- a frame by its samples --- */

bool study_frame(sim *s, int k, const study_each *each, double *cost_s) {
    *cost_s = 0;
    for (int j = 0; j < s->samples; j++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const double time_s = (k * s->samples + j + 1) * s->sample_s;
        if (each->before) each->before(each->user, j);
        for (int i = 0; i < s->instrument_count; i++) to[i] = sim_hand_pose(s, i, time_s);
        const double before_s = app_processor_s();
        if (sim_sample(s, to, s->substeps / s->samples) || s->broken_off) return false;
        if (each->after) each->after(each->user, s, j);
        if (j == s->samples - 1) sim_frame_end(s);
        *cost_s += app_processor_s() - before_s;
    }
    return true;
}

/* A force is the mean of the last substeps: of a sample, or, with one sample per frame, of the frame, which has more of
 * them. */
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

/* --- a run --- */

/* Keeps the first line of the message, without its "scene.yaml:12: " if it stays readable. */
static void keep_words(FILE *said, char *why, size_t size) {
    char line[1000];
    rewind(said);
    why[0] = 0;
    while (fgets(line, sizeof line, said)) {
        if (strstr(line, "warning:")) continue;
        line[strcspn(line, "\n")] = 0;
        if (line[0]) {
            snprintf(why, size, "%s", line);
            return;
        }
    }
}

sim *study_build(const char *file, char *const *set, int set_count, char *why, size_t size) {
    app_scene *scene = NULL;
    sim *s = NULL;
    FILE *said = tmpfile();
    fflush(stderr);
    const int saved = said ? dup(STDERR_FILENO) : -1;
    if (saved >= 0) dup2(fileno(said), STDERR_FILENO);
    bool good = sim_scene_load(file, set, set_count, app_program_host(), &scene) == 0;
    if (good) scene->pace = SIM_LOCKSTEP; /* with haptics, haptics.rate sets the samples per frame */
    good = good && sim_create(scene, &s) == 0;
    fflush(stderr);
    if (saved >= 0) {
        dup2(saved, STDERR_FILENO);
        close(saved);
    }
    if (!good && said) keep_words(said, why, size);
    if (!good && !why[0]) snprintf(why, size, "could not be built");
    if (said) fclose(said);
    return good ? s : NULL;
}

/* Chooses the same vertices of the file in every run, since finer meshes keep their numbers, and converts them to the
 * mesh's numbers. */
static void choose_points(const sim *s, int own_vertices, int32_t point[STUDY_POINTS]) {
    int32_t *vertex = app_zeroed((size_t)s->mesh->vertex_count, sizeof *vertex);
    sim_vertices_of_file(s, vertex);
    for (int p = 0; p < STUDY_POINTS; p++) point[p] = vertex[(size_t)p * (size_t)own_vertices / STUDY_POINTS];
    free(vertex);
}

static void read_shape(const sim *s, const int32_t point[STUDY_POINTS], study_run *r, int frame) {
    const double *u = sim_displacement(s);
    for (int m = 0; m < STUDY_MOMENTS; m++) {
        if (llround(r->frames * (m + 1.0) / (STUDY_MOMENTS + 1)) != frame) continue;
        for (int p = 0; p < r->points; p++)
            memcpy(r->u_m + 3 * ((size_t)m * STUDY_POINTS + (size_t)p), u + 3 * (size_t)point[p], 3 * sizeof *u);
    }
}

int study_threads(const sim *s) { return s->model->world ? tm_world_partitions(s->model->world) : 1; }

static void read_memory(study_run *r, const sim *s, double duration_s) {
    r->frames = (int)llround(duration_s / s->frame_s);
    r->instruments = s->instrument_count;
    r->frame_s = s->frame_s, r->dt_s = s->dt_s, r->substeps = s->substeps, r->tets = s->mesh->tet_count;
    r->threads = study_threads(s);
    /* The precomputed model moves only the surface. */
    r->points = r->foreign || s->scene->model.index == APP_PRECOMPUTED ? 0 : STUDY_POINTS;
    r->force_N = app_zeroed((size_t)r->frames * (size_t)r->instruments * 3, sizeof(double));
    r->u_m = app_zeroed((size_t)STUDY_MOMENTS * STUDY_POINTS * 3, sizeof(double));
}

/* Runs the frames. The cost is processor time, which other programs affect least; with several threads it does not give
 * the duration. */
static void drive(study *t, study_run *r, sim *s, double *cost_s, double *busy_s) {
    int32_t point[STUDY_POINTS];
    char label[120];
    if (r->points) choose_points(s, t->own_vertices, point);
    snprintf(label, sizeof label, "%s: %s", r->knob, r->name);
    const double wall = app_seconds();
    for (int k = 1; k <= r->frames && !app_interrupted(); k++) {
        const double began = app_seconds();
        const bool good = study_frame(s, k - 1, &(study_each){0}, &cost_s[k - 1]);
        if (s->broken_off) return;
        busy_s[k - 1] = r->threads > 1 ? app_seconds() - began : cost_s[k - 1];
        if (!good) {
            r->failed = true;
            snprintf(r->why, sizeof r->why, "went unstable in frame %d", k);
            return;
        }
        for (int i = 0; i < r->instruments; i++)
            memcpy(r->force_N + 3 * ((size_t)(k - 1) * (size_t)r->instruments + (size_t)i), s->reaction[i].force_N,
                   3 * sizeof(double));
        read_shape(s, point, r, k);
        study_doing(t, label, (double)k / r->frames);
        if (!study_goes_on(t, r, k)) return;
    }
    study_doing(t, label, 1);
    r->wall_s = (app_seconds() - wall) / r->frames;
}

void study_measure_cost(study_run *r, double *cost_s, double *busy_s, int frames) {
    r->cpu_s = 0;
    for (int k = 0; k < frames; k++) r->cpu_s += cost_s[k] / frames;
    r->cpu_p95_s = app_percentile(cost_s, frames, 0.95);
    r->busy_p95_s = app_percentile(busy_s, frames, 0.95);
}

static void run_frames(study *t, study_run *r, sim *s) {
    read_memory(r, s, t->duration_s);
    double *cost_s = app_zeroed((size_t)r->frames, sizeof *cost_s);
    double *busy_s = app_zeroed((size_t)r->frames, sizeof *busy_s);
    drive(t, r, s, cost_s, busy_s);
    study_measure_cost(r, cost_s, busy_s, r->frames);
    free(cost_s);
    free(busy_s);
}

int study_measure(study *t, study_run *r) {
    if (study_find(t, r)) return 0;
    const double start = app_processor_s();
    char label[120];
    snprintf(label, sizeof label, "%s: %s, set-up", r->knob, r->name);
    study_doing(t, label, 0);
    app_solve_allow(t->time.run_allowed_s);
    sim *s = study_build(t->file, r->set, r->set_count, r->why, sizeof r->why);
    const double beyond_s = app_solve_beyond();
    app_solve_allow(INFINITY);
    if (!s && beyond_s > 0) {
        study_leave_out(r, "by the solver's first columns", beyond_s, t->time.run_allowed_s);
        return app_interrupted() ? app_interrupted_exit() : 0;
    }
    r->failed = !s;
    if (s) {
        r->setup_s = app_processor_s() - start;
        run_frames(t, r, s);
        sim_destroy(s);
    }
    if (app_interrupted()) return app_interrupted_exit();
    if (r->left_out || (r == t->run && t->time.cut_at)) return 0;
    r->done = true;
    return study_save(t, false);
}
