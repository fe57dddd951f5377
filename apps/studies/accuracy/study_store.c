/* The results file of a study: written after every run, so that Ctrl-C loses at most one run, and read by the next
 * call. */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "study.h"

void study_open(study *t) { t->old = app_json_read(t->json); }

/* Fields of a run in the file, except of failed runs. */
static const struct {
    const char *name;
    size_t at;
    bool whole; /* an int, else a double */
} member[] = {
#define RUN_INT(name)                                                                                                  \
    { #name, offsetof(study_run, name), true }
#define RUN_DOUBLE(name)                                                                                               \
    { #name, offsetof(study_run, name), false }
    RUN_INT(frames),     RUN_INT(instruments),   RUN_INT(points),     RUN_INT(tets),     RUN_INT(substeps),
    RUN_DOUBLE(frame_s), RUN_DOUBLE(dt_s),       RUN_DOUBLE(setup_s), RUN_DOUBLE(cpu_s), RUN_DOUBLE(cpu_p95_s),
    RUN_DOUBLE(wall_s),  RUN_DOUBLE(busy_p95_s), RUN_INT(threads)};
enum { MEMBERS = sizeof member / sizeof *member };

static double number(const cJSON *from, const char *name) {
    const cJSON *item = cJSON_GetObjectItem(from, name);
    return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

static double *numbers(const cJSON *from, const char *name, size_t count) {
    const cJSON *list = cJSON_GetObjectItem(from, name), *item;
    if ((size_t)cJSON_GetArraySize(list) != count) return NULL;
    double *out = calloc(count + 1, sizeof *out);
    size_t i = 0;
    cJSON_ArrayForEach(item, list) {
        if (out && i < count) out[i++] = cJSON_IsNumber(item) ? item->valuedouble : 0;
    }
    return out;
}

static bool take(study_run *r, const cJSON *from) {
    const cJSON *why = cJSON_GetObjectItem(from, "cannot");
    r->failed = cJSON_IsString(why);
    if (r->failed) {
        snprintf(r->why, sizeof r->why, "%s", why->valuestring);
        return true;
    }
    for (int i = 0; i < MEMBERS; i++) {
        char *to = (char *)r + member[i].at;
        if (member[i].whole)
            *(int *)(void *)to = (int)number(from, member[i].name);
        else
            *(double *)(void *)to = number(from, member[i].name);
    }
    if (r->frames < 1 || r->frames > 10000000 || r->instruments < 1 || r->instruments > TM_MAX_INSTRUMENTS)
        return false;
    double *felt = numbers(from, "felt", STUDY_LATE);
    if (felt) memcpy(r->felt, felt, sizeof r->felt);
    r->felt_known = felt != NULL;
    free(felt);
    if (r->felt_known) {
        r->change = number(from, "change");
        return r->frame_s > 0 && r->cpu_s > 0 && r->busy_p95_s > 0;
    }
    r->force_N = numbers(from, "force_N", (size_t)r->frames * (size_t)r->instruments * 3);
    r->u_m = numbers(from, "u_m", (size_t)STUDY_MOMENTS * STUDY_POINTS * 3);
    return r->force_N && r->u_m && r->frame_s > 0 && r->cpu_s > 0 && r->busy_p95_s > 0;
}

double study_old_span_s(const study *t, double asked_s) {
    const double span_s = number(t->old, "duration_s");
    const bool same =
        t->old && number(t->old, "asked_duration_s") == asked_s && number(t->old, "limit_s") >= t->limit_s;
    return same && span_s > 0 && span_s < asked_s ? span_s : asked_s;
}

bool study_find(const study *t, study_run *r) {
    const cJSON *one;
    cJSON_ArrayForEach(one, cJSON_GetObjectItem(t->old, "runs")) {
        const char *key = cJSON_GetStringValue(cJSON_GetObjectItem(one, "key"));
        if (key && !strcmp(key, r->key) && take(r, one)) return r->done = r->reused = true;
    }
    return false;
}

static cJSON *words(char *const *text, int count) { return cJSON_CreateStringArray((const char *const *)text, count); }

static cJSON *run_json(const study *t, const study_run *r) {
    static const char *const sends[] = {"force", "stiffness", "patch"};
    cJSON *out =
        app_json_add(cJSON_CreateObject(), "key %s knob %s name %s form %d", r->key, r->knob, r->name, r->form);
    cJSON_AddItemToObject(out, "set", words(r->set + r->edits_from, r->set_count - r->edits_from));
    if (r->failed) return app_json_add(out, "cannot %s", r->why);
    for (int i = 0; i < MEMBERS; i++) {
        const char *from = (const char *)r + member[i].at;
        const double value = member[i].whole ? *(const int *)(const void *)from : *(const double *)(const void *)from;
        if (isfinite(value)) cJSON_AddNumberToObject(out, member[i].name, value);
    }
    app_json_add(out, "share %f", r->cpu_p95_s / r->frame_s);
    if (t->truth.force_N)
        app_json_add(out, "force_error %f shape_error %f change %f peak_change %f", r->force_error, r->shape_error,
                     r->change, r->peak_change);
    if (r->felt_known) {
        if (!t->truth.force_N) app_json_add(out, "change %f", r->change);
        app_json_add(out, "law %s sample_rate_Hz %f sends %s", hrt_extrapolator_name((hrt_extrapolator)r->law),
                     study_rate_Hz(t, r), sends[r->sends]);
        if (t->truth.force_N) app_json_add(out, "best_at_rate %hhd", r == &t->run[study_best_at(t, r->times)]);
        cJSON_AddItemToObject(out, "felt", cJSON_CreateDoubleArray(r->felt, STUDY_LATE));
        return out;
    }
    cJSON_AddItemToObject(out, "force_N", cJSON_CreateDoubleArray(r->force_N, r->frames * r->instruments * 3));
    cJSON_AddItemToObject(out, "u_m", cJSON_CreateDoubleArray(r->u_m, STUDY_MOMENTS * STUDY_POINTS * 3));
    return out;
}

static void add_truth(cJSON *out, const study *t) {
    const study_truth *h = &t->truth;
    app_json_add(out, "extrapolated %hhd finest %s finest_tets %d order %f order_observed %hhd uncertainty %f rms_N %f",
                 h->extrapolated, t->run[h->fine].name, t->run[h->fine].tets, h->order, h->order_observed,
                 h->uncertainty, h->rms_N);
    cJSON_AddItemToObject(out, "force_N", cJSON_CreateDoubleArray(h->force_N, h->frames * h->instruments * 3));
}

static void add_choice(cJSON *out, const study *t) {
    const study_choice *c = &t->choice;
    const study_run *felt = &t->run[c->felt_run];
    char text[500];
    cJSON *names = cJSON_AddArrayToObject(out, "settings");
    app_json_add(out, "budget %f fits %hhd", t->budget, c->fits);
    cJSON_AddItemToArray(names, cJSON_CreateString(t->run[c->mesh_run].name));
    for (int i = 0; i < c->extra_count; i++) cJSON_AddItemToArray(names, cJSON_CreateString(t->run[c->extra[i]].name));
    if (c->felt_run) {
        study_rate_reason(t, text, sizeof text);
        app_json_add(out, "extrapolator %s sample_rate_Hz %f felt_error %f rate_reason %s",
                     hrt_extrapolator_name((hrt_extrapolator)felt->law), study_rate_Hz(t, felt), felt->force_error,
                     text);
    }
    app_json_add(out, "untried %hhd file %s error %f predicted_error %f worse %d cost_s %f frame_s %f share %f busy %f",
                 c->untried, c->file, c->error, c->predicted, t->worse, c->cost_s, c->frame_s, c->share, c->busy);
    if (!c->held_frames) return;
    study_verdict(c, text, sizeof text);
    app_json_add(
        out,
        "verdict %s kept %hhd real_time %hhd held_error %f held_share %f held_over %f held_dearer %f held_slower %f held_wall_s %f held_frames %d held_late %d",
        text, c->kept, c->real_time, c->held_error, c->held_share, c->held.over, c->held.costlier, c->held.slower,
        c->held_wall_s, c->held_frames, c->held_late);
}

int study_save(const study *t, bool whole) {
    char hash[17];
    cJSON *root = cJSON_CreateObject();
    snprintf(hash, sizeof hash, "%016llx", (unsigned long long)t->scene_hash);
    app_json_add(root, "study %s scene %s scene_hash %s version %s", "tensormass accuracy of a scene", t->file, hash,
                 tm_version());
    cJSON_AddItemToObject(root, "set", words(t->set, t->set_count));
    app_json_add(root, "whole %hhd duration_s %f asked_duration_s %f limit_s %f", whole, t->duration_s, t->asked_s,
                 t->limit_s);
    cJSON *left_out = cJSON_AddArrayToObject(root, "left_out");
    for (int i = 0; i < t->run_count; i++)
        if (t->run[i].left_out)
            app_json_add(left_out, "knob %s name %s why %s", t->run[i].knob, t->run[i].name, t->run[i].why);
    if (whole) add_truth(cJSON_AddObjectToObject(root, "truth"), t);
    if (whole && t->choice.wanted) add_choice(cJSON_AddObjectToObject(root, "recommendation"), t);
    cJSON *runs = cJSON_AddArrayToObject(root, "runs");
    for (int i = 0; i < t->run_count; i++)
        if (t->run[i].done) cJSON_AddItemToArray(runs, run_json(t, &t->run[i]));
    /* Earlier runs that this call has not reached, or does not need, are kept. */
    const cJSON *one;
    cJSON_ArrayForEach(one, cJSON_GetObjectItem(t->old, "runs")) {
        const char *key = cJSON_GetStringValue(cJSON_GetObjectItem(one, "key"));
        bool here = !key;
        for (int i = 0; i < t->run_count && !here; i++) here = t->run[i].done && !strcmp(t->run[i].key, key);
        if (!here && !whole) cJSON_AddItemToArray(runs, cJSON_Duplicate(one, true));
    }
    const int rc = app_json_save(t->json, root);
    cJSON_Delete(root);
    return rc;
}
