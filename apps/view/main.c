/* tm-view: renders pictures and video of tissue, instruments and forces, from a running simulation, a log, a scene or a
 * mesh. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "app.h"
#include "json_file.h"
#include "message_source.h"
#include "options.h"
#include "output.h"
#include "scene_decoration.h"

/* State of the current job, and the figures for --json. */
typedef struct job {
    view_options options;
    view_studio studio;
    view_picture picture;
    view_dress dress; /* decoration from the scene */
    view_feed *feed;
    view_video video;
    bool filming;
    int64_t pictures, numbered;
    double began_s, drawing_s;
    view_log_facts facts;
} job;

static double now_s(void) { return (double)app_monotonic_us() * 1e-6; }

static int complain(tm_error *error) { return app_report("tm-view", 0, error); }

static int draw(job *j) {
    tm_error error = {0};
    double start = now_s();
    view_picture shown;
    const int wrong = view_dress_show(&j->dress, &j->picture, &shown);
    if (wrong) return wrong;
    tm_status status = view_studio_draw(&j->studio, &shown, &error);
    j->drawing_s += now_s() - start;
    j->pictures++;
    return status ? complain(&error) : 0;
}

static int write_png(job *j, const char *path) {
    tm_error error = {0};
    const view_canvas *c = &j->studio.canvas;
    return view_png_write(path, c->width, c->height, c->rgb, &error) ? complain(&error) : 0;
}

/* Draws one picture of a sequence and writes it to the requested outputs. */
static int sequence_picture(job *j) {
    tm_error error = {0};
    int wrong = draw(j);
    if (!wrong && j->options.frames) {
        char path[1100];
        snprintf(path, sizeof path, "%.1024s/frame_%05lld.png", j->options.frames, (long long)j->numbered);
        wrong = write_png(j, path);
    }
    j->numbered++;
    if (!wrong && j->filming && view_video_add(&j->video, j->studio.canvas.rgb, &error)) wrong = complain(&error);
    return wrong;
}

static int begin_outputs(job *j) {
    tm_error error = {0};
    const view_options *o = &j->options;
    if (o->frames && mkdir(o->frames, 0777) && errno != EEXIST)
        return app_bad_input(o->frames, 0, "cannot be made (%s); name a folder that can", strerror(errno));
    if (o->video) {
        if (view_video_begin(&j->video, o->video, o->studio.render.width, o->studio.render.height, o->fps, &error))
            return complain(&error);
        j->filming = true;
    }
    return 0;
}

static int end_outputs(job *j, int wrong) {
    tm_error error = {0};
    if (!j->filming) return wrong;
    j->filming = false;
    if (wrong)
        view_video_abandon(&j->video);
    else if (view_video_end(&j->video, &error))
        wrong = complain(&error);
    return wrong;
}

static int show_still(job *j) {
    int wrong = begin_outputs(j);
    int count = j->options.frames || j->options.video ? (int)fmax(1, rint(j->options.duration_s * j->options.fps)) : 0;
    for (int i = 0; i < count && !wrong; i++) {
        j->picture.time_s = (double)i / j->options.fps;
        wrong = sequence_picture(j);
        app_progress("drawing", (double)i / count, false);
    }
    app_progress("drawing", 1, true);
    wrong = end_outputs(j, wrong);
    if (!wrong && j->options.png) {
        j->picture.time_s = j->options.at_s;
        if (!(wrong = draw(j))) wrong = write_png(j, j->options.png);
    }
    return wrong;
}

static int log_sequence(job *j) {
    const view_options *o = &j->options;
    double to_s = o->has_to ? fmin(o->to_s, j->facts.seconds) : j->facts.seconds;
    int wrong = begin_outputs(j);
    int64_t count = (int64_t)floor((to_s - o->from_s) * o->fps + 1e-6) + 1;
    for (int64_t i = 0; i < count && !wrong; i++) {
        view_feed_advance(j->feed, o->from_s + (double)i / o->fps, &j->picture);
        wrong = sequence_picture(j);
        app_progress("drawing the log", (double)i / (double)count, false);
    }
    app_progress("drawing the log", 1, true);
    return end_outputs(j, wrong);
}

static int open_log(job *j) {
    tm_error error = {0};
    if (view_feed_open_log(j->options.source, &j->feed, &j->facts, &error))
        return app_report(j->options.source, 0, &error);
    if (j->facts.damaged)
        fprintf(stderr, "%s: is damaged or truncated; only complete messages are shown\n", j->options.source);
    j->studio.peak_force_N = j->facts.peak_force_N;
    if (j->options.from_s > j->facts.seconds || (j->options.has_at && j->options.at_s > j->facts.seconds))
        return app_bad_input(j->options.source, 0, "lasts %.2f s; choose --from and --at before that",
                             j->facts.seconds);
    return 0;
}

static int show_log(job *j) {
    int wrong = open_log(j);
    if (wrong) return wrong;
    bool sequence = j->options.frames || j->options.video;
    if (j->options.png && (!sequence || j->options.has_at)) {
        double at_s = j->options.has_at ? j->options.at_s : j->facts.seconds;
        view_feed_advance(j->feed, at_s, &j->picture);
        if (!(wrong = draw(j))) wrong = write_png(j, j->options.png);
        if (wrong || !sequence) return wrong;
        view_feed_close(j->feed);
        j->feed = NULL;
        view_picture_free(&j->picture);
        const view_picture seen = j->picture;
        j->picture = (view_picture){.regions = seen.regions};
        memcpy(j->picture.region, seen.region, sizeof seen.region);
        view_dress_restart(&j->dress);
        view_studio_refit(&j->studio);
        if ((wrong = open_log(j))) return wrong;
        return log_sequence(j);
    }
    wrong = log_sequence(j);
    if (!wrong && j->options.png) wrong = write_png(j, j->options.png);
    return wrong;
}

/* Waits for the first tissue; reports it once. */
static int wait_for_tissue(job *j) {
    double began = now_s();
    bool said = false;
    while (!j->picture.surface.vertex_count) {
        view_feed_listen(j->feed, 50, &j->picture);
        double waited = now_s() - began;
        if (!said && waited > 0.5) said = true, app_remark("tm-view: %s", j->picture.notice);
        if (waited > j->options.wait_s)
            return app_bad_input(
                       "tm-view", 0,
                       "no TISSUE message within %g s; start tm-sim --realtime SCENE in the same network namespace, or "
                       "raise --wait",
                       j->options.wait_s) -
                   1;
    }
    return 0;
}

static int live_sequence(job *j) {
    int wrong = begin_outputs(j);
    double began = now_s(), due = began;
    int64_t count = (int64_t)fmax(1, rint(j->options.duration_s * j->options.fps));
    for (int64_t i = 0; i < count && !wrong; ++i, due += 1.0 / j->options.fps) {
        view_feed_listen(j->feed, (int)fmax(0, 1e3 * (due - now_s())), &j->picture);
        j->studio.drawn_hz = i ? (double)i / (now_s() - began) : 0;
        wrong = sequence_picture(j);
        app_progress("recording", (double)i / (double)count, false);
    }
    app_progress("recording", 1, true);
    return end_outputs(j, wrong);
}

static int show_live(job *j) {
    tm_error error = {0};
    const view_live_key key = {.path = j->options.key, .none = true}; /* a viewer that only reads needs no key */
    if (view_feed_open_live(j->options.url, &key, &j->feed, &error)) return complain(&error);
    int wrong = wait_for_tissue(j);
    if (!wrong && (j->options.frames || j->options.video))
        wrong = live_sequence(j);
    else if (!wrong) {
        view_feed_listen(j->feed, 150, &j->picture); /* messages SIM_STATUS and the controllers' follow the tissue */
        wrong = draw(j);
    }
    if (!wrong && j->options.png) wrong = write_png(j, j->options.png);
    return wrong;
}

static int write_json(job *j) {
    tm_error error = {0};
    view_feed_counts counts = {0};
    if (j->feed) counts = view_feed_counted(j->feed);
    const struct {
        const char *name;
        double value;
    } figure[] = {{"pictures", (double)j->pictures},
                  {"seconds", now_s() - j->began_s},
                  {"drawing_seconds", j->drawing_s},
                  {"pictures_per_second", j->drawing_s > 0 ? (double)j->pictures / j->drawing_s : 0},
                  {"width", j->studio.canvas.width},
                  {"height", j->studio.canvas.height},
                  {"vertices", j->picture.surface.vertex_count},
                  {"triangles", j->picture.surface.triangle_count},
                  {"topology_revision", j->picture.surface.revision},
                  {"log_seconds", j->facts.seconds},
                  {"log_tissues", (double)j->facts.tissues},
                  {"peak_force_N", j->studio.peak_force_N},
                  {"messages_taken", (double)counts.accepted},
                  {"messages_refused", (double)counts.rejected}};
    cJSON *root = cJSON_CreateObject();
    for (size_t i = 0; i < sizeof figure / sizeof *figure; i++)
        cJSON_AddNumberToObject(root, figure[i].name, figure[i].value);
    tm_status status = app_json_write(j->options.json, root, &error);
    cJSON_Delete(root);
    return status ? complain(&error) : 0;
}

static int run(job *j) {
    const view_options *o = &j->options;
    tm_error error = {0};
    bool still = o->source && view_is_still(o->source);
    j->dress = view_options_dress(o);
    int wrong = still ? view_still_load(o->source, o->scale, &o->marks, &o->cut, &j->picture, &j->dress.marks)
                      : view_dress_load(&j->dress, &j->picture);
    if (wrong) return wrong;
    if (view_studio_open(&j->studio, &o->studio, &error)) return complain(&error);
    wrong = still ? show_still(j) : o->source ? show_log(j) : show_live(j);
    if (!wrong && j->feed) {
        view_feed_counts counts = view_feed_counted(j->feed);
        if (counts.rejected)
            fprintf(stderr, "tm-view: %lld messages refused, the last for: %s\n", (long long)counts.rejected,
                    counts.why);
    }
    if (!wrong && o->json) wrong = write_json(j);
    return wrong;
}

int main(int argc, char **argv) {
    static job j;
    app_check_stdout();
    int wrong = view_options_parse(argc, argv, &j.options);
    if (wrong || j.options.finished) return wrong;
    j.began_s = now_s();
    wrong = run(&j);
    if (j.feed) view_feed_close(j.feed);
    if (j.studio.api) view_studio_close(&j.studio);
    view_picture_free(&j.picture);
    view_dress_free(&j.dress);
    return wrong;
}
