/* tm-sim --hands: exports scene data for the other programs of a session. Scripted hands as CSV, which tm-device plays;
 * instrument modes and controller settings as JSON, for scripts that start the session. */
#include <cjson/cJSON.h>
#include <stdio.h>

#include "hrt.h"
#include "json_file.h"
#include "mode.h"
#include "run.h"
#include "scene/effects.h"

static void write_key(FILE *out, int joints, double time_s, const double *joint, bool active) {
    fprintf(out, "%.17g", time_s);
    for (int j = 0; j < joints; j++) fprintf(out, ",%.17g", joint[j]);
    fprintf(out, ",%d\n", active);
}

static int write_hand(const sim *s, int i, const char *path) {
    const hrt_hand_script *hand = &s->hand[i];
    app_file file = {0};
    int rc = app_file_begin(&file, path);
    if (rc) return rc;
    const hrt_device_type *device = s->axes[i].device;
    fputs("time_s", file.stream);
    for (int j = 0; j < device->joints; j++) fprintf(file.stream, ",%s", device->joint[j].name);
    fputs(",active\n", file.stream);
    if (!hand->key) write_key(file.stream, device->joints, 0, s->start_joint[i], false);
    for (int k = 0; k < hand->key_count; k++)
        write_key(file.stream, device->joints, hand->key[k].time_s, hand->key[k].joint, hand->key[k].active);
    return app_file_end(&file, true);
}

static int write_session(const sim *s, const char *path) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    app_file file = {0};
    int rc = app_file_begin(&file, path);
    if (rc) return rc;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "title", s->scene->title.s);
    cJSON_AddNumberToObject(json, "duration_s", s->scene->duration.si);
    cJSON_AddNumberToObject(json, "frame_s", s->frame_s);
    if (haptics) {
        cJSON_AddStringToObject(json, "extrapolator",
                                hrt_extrapolator_name((hrt_extrapolator)haptics->extrapolator.index));
        cJSON_AddBoolToObject(json, "passivity", haptics->passivity.on);
        cJSON_AddNumberToObject(json, "rate_Hz", haptics->tick_rate.si);
    }
    cJSON *list = cJSON_AddArrayToObject(json, "instruments");
    for (int i = 0; i < s->instrument_count; i++) {
        const hrt_hand_script *hand = &s->hand[i];
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "device", s->axes[i].device->name);
        cJSON_AddStringToObject(row, "mode", hrt_mode_name((hrt_mode)s->instrument_def[i].mode));
        cJSON_AddItemToObject(row, "start_joint",
                              cJSON_CreateDoubleArray(s->start_joint[i], s->axes[i].device->joints));
        cJSON_AddNumberToObject(row, "tremor_m", hand->tremor_m);
        cJSON_AddBoolToObject(row, "straight", hand->straight);
        cJSON_AddBoolToObject(row, "repeat", hand->repeat);
    }
    return app_file_end_json(&file, json);
}

int run_hands(sim *s, const run_options *o) {
    char path[1024];
    for (int i = 0; i < s->instrument_count; i++) {
        snprintf(path, sizeof path, "%.1000s%d.csv", o->hands, i);
        int rc = write_hand(s, i, path);
        if (rc) return rc;
    }
    snprintf(path, sizeof path, "%.1000s.json", o->hands);
    return write_session(s, path);
}
