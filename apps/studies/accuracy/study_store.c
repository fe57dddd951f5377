/* The file of a study: written after every run, so that Ctrl-C loses one run at most, and read again by the next. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "study.h"

void study_open(study *t) {
    FILE *file = fopen(t->json, "rb");
    char *text = NULL;
    long size = 0;
    if (file && fseek(file, 0, SEEK_END) == 0 && (size = ftell(file)) > 0 && (text = malloc((size_t)size + 1))) {
        rewind(file);
        text[fread(text, 1, (size_t)size, file)] = 0;
        t->old = cJSON_Parse(text);
    }
    free(text);
    if (file) fclose(file);
}

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
    r->frames = (int)number(from, "frames"), r->instruments = (int)number(from, "instruments");
    r->points = (int)number(from, "points"), r->tets = (int)number(from, "tets");
    r->substeps = (int)number(from, "substeps");
    r->frame_s = number(from, "frame_s"), r->dt_s = number(from, "dt_s"), r->setup_s = number(from, "setup_s");
    r->cpu_s = number(from, "cpu_s"), r->cpu_p95_s = number(from, "cpu_p95_s"), r->wall_s = number(from, "wall_s");
    r->busy_p95_s = number(from, "busy_p95_s"), r->threads = (int)number(from, "threads");
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

static void put(cJSON *to, const char *name, double value) {
    if (isfinite(value)) cJSON_AddNumberToObject(to, name, value);
}

static cJSON *run_json(const study *t, const study_run *r) {
    cJSON *out = cJSON_CreateObject();
    app_json_add(out, "key %s knob %s name %s form %d", r->key, r->knob, r->name, r->form);
    cJSON_AddItemToObject(
        out, "set", cJSON_CreateStringArray((const char *const *)r->set + r->edits_from, r->set_count - r->edits_from));
    if (r->failed) {
        app_json_add(out, "cannot %s", r->why);
        return out;
    }
    put(out, "frames", r->frames), put(out, "instruments", r->instruments), put(out, "points", r->points);
    put(out, "tets", r->tets), put(out, "substeps", r->substeps), put(out, "frame_s", r->frame_s);
    put(out, "dt_s", r->dt_s), put(out, "setup_s", r->setup_s), put(out, "cpu_s", r->cpu_s);
    put(out, "cpu_p95_s", r->cpu_p95_s), put(out, "wall_s", r->wall_s);
    put(out, "busy_p95_s", r->busy_p95_s), put(out, "threads", r->threads);
    put(out, "share", r->cpu_p95_s / r->frame_s);
    if (t->truth.force_N) {
        put(out, "force_error", r->force_error), put(out, "shape_error", r->shape_error);
        put(out, "change", r->change), put(out, "peak_change", r->peak_change);
    }
    if (r->felt_known) {
        static const char *const sends[] = {"force", "stiffness", "patch"};
        if (!t->truth.force_N) put(out, "change", r->change);
        app_json_add(out, "law %s", hrt_extrapolator_name((hrt_extrapolator)r->law));
        put(out, "sample_rate_Hz", study_rate_Hz(t, r));
        app_json_add(out, "sends %s", sends[r->sends]);
        if (t->truth.force_N) cJSON_AddBoolToObject(out, "best_at_rate", r == &t->run[study_best_at(t, r->times)]);
        cJSON_AddItemToObject(out, "felt", cJSON_CreateDoubleArray(r->felt, STUDY_LATE));
        return out;
    }
    cJSON_AddItemToObject(out, "force_N", cJSON_CreateDoubleArray(r->force_N, r->frames * r->instruments * 3));
    cJSON_AddItemToObject(out, "u_m", cJSON_CreateDoubleArray(r->u_m, STUDY_MOMENTS * STUDY_POINTS * 3));
    return out;
}

static cJSON *truth_json(const study *t) {
    const study_truth *h = &t->truth;
    cJSON *out = cJSON_CreateObject();
    app_json_add(out, "extrapolated %hhd finest %s", h->extrapolated, t->run[h->fine].name);
    put(out, "finest_tets", t->run[h->fine].tets), put(out, "order", h->order);
    app_json_add(out, "order_observed %hhd", h->order_observed);
    put(out, "uncertainty", h->uncertainty), put(out, "rms_N", h->rms_N);
    cJSON_AddItemToObject(out, "force_N", cJSON_CreateDoubleArray(h->force_N, h->frames * h->instruments * 3));
    return out;
}

static cJSON *choice_json(const study *t) {
    const study_choice *c = &t->choice;
    cJSON *out = cJSON_CreateObject(), *names = cJSON_AddArrayToObject(out, "settings");
    put(out, "budget", t->budget);
    app_json_add(out, "fits %hhd", c->fits);
    cJSON_AddItemToArray(names, cJSON_CreateString(t->run[c->mesh_run].name));
    for (int i = 0; i < c->extra_count; i++) cJSON_AddItemToArray(names, cJSON_CreateString(t->run[c->extra[i]].name));
    const study_run *felt = &t->run[c->felt_run];
    if (c->felt_run) {
        app_json_add(out, "extrapolator %s", hrt_extrapolator_name((hrt_extrapolator)felt->law));
        put(out, "sample_rate_Hz", study_rate_Hz(t, felt)), put(out, "felt_error", felt->force_error);
        char why[400];
        study_rate_reason(t, why, sizeof why);
        app_json_add(out, "rate_reason %s", why);
    }
    app_json_add(out, "untried %hhd file %s", c->untried, c->file);
    put(out, "error", c->error), put(out, "predicted_error", c->predicted), put(out, "worse", t->worse);
    put(out, "cost_s", c->cost_s), put(out, "frame_s", c->frame_s), put(out, "share", c->share),
        put(out, "busy", c->busy);
    if (!c->held_frames) return out;
    char verdict[500];
    study_verdict(c, verdict, sizeof verdict);
    app_json_add(out, "verdict %s kept %hhd real_time %hhd", verdict, c->kept, c->real_time);
    put(out, "held_error", c->held_error), put(out, "held_share", c->held_share), put(out, "held_over", c->held.over);
    put(out, "held_dearer", c->held.dearer), put(out, "held_slower", c->held.slower);
    put(out, "held_wall_s", c->held_wall_s), put(out, "held_frames", c->held_frames);
    put(out, "held_late", c->held_late);
    return out;
}

int study_save(const study *t, bool whole) {
    char hash[17];
    tm_error error = {0};
    cJSON *root = cJSON_CreateObject();
    snprintf(hash, sizeof hash, "%016llx", (unsigned long long)t->scene_hash);
    app_json_add(root, "study %s scene %s scene_hash %s version %s", "tensormass accuracy of a scene", t->file, hash,
                 tm_version());
    cJSON_AddItemToObject(root, "set", cJSON_CreateStringArray((const char *const *)t->set, t->set_count));
    app_json_add(root, "whole %hhd", whole);
    put(root, "duration_s", t->duration_s), put(root, "asked_duration_s", t->asked_s);
    put(root, "limit_s", t->limit_s);
    cJSON *left_out = cJSON_AddArrayToObject(root, "left_out");
    for (int i = 0; i < t->run_count; i++) {
        if (!t->run[i].left_out) continue;
        cJSON *one = cJSON_CreateObject();
        cJSON_AddItemToArray(left_out, one);
        app_json_add(one, "knob %s name %s why %s", t->run[i].knob, t->run[i].name, t->run[i].why);
    }
    if (whole) cJSON_AddItemToObject(root, "truth", truth_json(t));
    if (whole && t->choice.wanted) cJSON_AddItemToObject(root, "recommendation", choice_json(t));
    cJSON *runs = cJSON_AddArrayToObject(root, "runs");
    for (int i = 0; i < t->run_count; i++)
        if (t->run[i].done) cJSON_AddItemToArray(runs, run_json(t, &t->run[i]));
    /* Runs of before that this call has not come to yet, or does not ask for, stay. */
    const cJSON *one;
    cJSON_ArrayForEach(one, cJSON_GetObjectItem(t->old, "runs")) {
        const char *key = cJSON_GetStringValue(cJSON_GetObjectItem(one, "key"));
        bool here = !key;
        for (int i = 0; i < t->run_count && !here; i++) here = t->run[i].done && !strcmp(t->run[i].key, key);
        if (!here && !whole) cJSON_AddItemToArray(runs, cJSON_Duplicate(one, true));
    }
    const int rc = app_json_write(t->json, root, &error) ? app_report(NULL, 0, &error) : 0;
    cJSON_Delete(root);
    return rc;
}
