/* Reads the study of a scene for tm-sim --explain. */
#include "study_summary.h"
#include "json_file.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

/* FNV-1a, http://www.isthe.com/chongo/tech/comp/fnv/ */
uint64_t sim_hash_bytes(uint64_t hash, const void *data, size_t size) {
    const unsigned char *byte = data;
    if (!hash) hash = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) hash = (hash ^ byte[i]) * 1099511628211u;
    return hash;
}

uint64_t sim_hash_file(uint64_t hash, const char *path) {
    unsigned char part[1 << 14];
    FILE *file = fopen(path, "rb");
    for (size_t n; file && (n = fread(part, 1, sizeof part, file)) > 0;) hash = sim_hash_bytes(hash, part, n);
    if (file) fclose(file);
    return hash;
}

static double number(const cJSON *from, const char *name) {
    const cJSON *item = cJSON_GetObjectItem(from, name);
    return cJSON_IsNumber(item) ? item->valuedouble : NAN;
}

/* Returns whether the study is complete and of exactly this text. Its settings may only leave out effects that no study
 * runs. */
static bool is_of(const cJSON *study, const sim *s) {
    char hash[17];
    const cJSON *set;
    const char *of = cJSON_GetStringValue(cJSON_GetObjectItem(study, "scene_hash"));
    snprintf(hash, sizeof hash, "%016llx", (unsigned long long)sim_hash_file(0, s->scene->file));
    cJSON_ArrayForEach(set, cJSON_GetObjectItem(study, "set")) {
        const char *text = cJSON_GetStringValue(set);
        if (!text || !sim_effect_left_out(text)) return false;
    }
    return of && !strcmp(of, hash) && cJSON_IsTrue(cJSON_GetObjectItem(study, "whole"));
}

void sim_expected_open(sim_expected *x, const sim *s) {
    *x = (sim_expected){.error = NAN, .uncertainty = NAN};
    const size_t length = strlen(s->scene->file);
    const size_t stem = length > 5 && !strcmp(s->scene->file + length - 5, ".yaml") ? length - 5 : length;
    snprintf(x->file, sizeof x->file, "%.*s.accuracy.json", (int)stem, s->scene->file);
    x->study = app_json_read(x->file);
    if (!x->study) return;
    const cJSON *own = cJSON_GetArrayItem(cJSON_GetObjectItem(x->study, "runs"), 0);
    x->error = number(own, "force_error");
    x->uncertainty = number(cJSON_GetObjectItem(x->study, "truth"), "uncertainty");
    if (is_of(x->study, s) && isfinite(x->error)) return;
    app_remark("%s is incomplete, or of an earlier state of this scene; run tm-accuracy --scene again", x->file);
    sim_expected_close(x);
}

void sim_expected_close(sim_expected *x) {
    cJSON_Delete(x->study);
    x->study = NULL;
}

/* Returns a figure of the run with that knob and name. */
static double of_run(const sim_expected *x, const char *knob, const char *name, const char *figure) {
    const cJSON *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(x->study, "runs")) {
        const char *of = cJSON_GetStringValue(cJSON_GetObjectItem(run, "knob")),
                   *called = cJSON_GetStringValue(cJSON_GetObjectItem(run, "name"));
        if (of && called && !strcmp(of, knob) && !strcmp(called, name)) return number(run, figure);
    }
    return NAN;
}

double sim_expected_without(const sim_expected *x, const char *effect) { return of_run(x, "drop", effect, "change"); }

double sim_expected_felt(const sim_expected *x, const char *extrapolator, double rate_Hz) {
    const cJSON *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(x->study, "runs")) {
        const char *law = cJSON_GetStringValue(cJSON_GetObjectItem(run, "law"));
        if (law && !strcmp(law, extrapolator) && fabs(number(run, "sample_rate_Hz") - rate_Hz) < 1e-3 * rate_Hz)
            return number(run, "force_error");
    }
    return NAN;
}

double sim_expected_mass(const sim_expected *x) { return of_run(x, "mass", "its own mass", "change"); }

double sim_expected_law(const sim_expected *x, const char **law) {
    const cJSON *run;
    cJSON_ArrayForEach(run, cJSON_GetObjectItem(x->study, "runs")) {
        const char *knob = cJSON_GetStringValue(cJSON_GetObjectItem(run, "knob"));
        *law = cJSON_GetStringValue(cJSON_GetObjectItem(run, "name"));
        if (knob && *law && !strcmp(knob, "law")) return number(run, "change");
    }
    return NAN;
}
