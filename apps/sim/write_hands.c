/* tm-sim --hands: what the other programs of a session need to know of the scene. The scripted hands as CSV, which tm-device plays, and the
 * instruments' modes and the controller's settings as JSON, for scripts that start the session. */
#include <cjson/cJSON.h>
#include <stdio.h>

#include "effects.h"
#include "hrt.h"
#include "run.h"

static int write_hand(const sim *s, int i, const app_hand *hand, const char *path) {
    run_file file = {0};
    int rc = run_file_begin(&file, path);
    if (rc) return rc;
    fputs("time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip,active\n", file.stream);
    if (!hand) {
        fputs("0", file.stream);
        for (int j = 0; j < SIM_JOINTS; ++j) fprintf(file.stream, ",%.17g", s->start_joint[i][j]);
        fputs(",0\n", file.stream);
    }
    for (int k = 0; hand && k < hand->path.count; ++k) {
        const app_waypoint *w = (const app_waypoint *)hand->path.item + k;
        double joint[SIM_JOINTS];
        sim_scene_joints(s, i, &w->pose, joint);
        fprintf(file.stream, "%.17g", w->time.si);
        for (int j = 0; j < SIM_JOINTS; ++j) fprintf(file.stream, ",%.17g", joint[j]);
        fprintf(file.stream, ",%d\n", w->active.on);
    }
    return run_file_end(&file, true);
}

static int write_session(const sim *s, const char *path) {
    static const char *const modes[] = {"probe", "grasper", "cautery"};
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    run_file file = {0};
    int rc = run_file_begin(&file, path);
    if (rc) return rc;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "title", s->scene->title.s);
    cJSON_AddNumberToObject(json, "duration_s", s->scene->duration.si);
    cJSON_AddNumberToObject(json, "frame_s", s->frame_s);
    if (haptics) {
        cJSON_AddStringToObject(json, "extrapolator", hrt_extrapolator_name((hrt_extrapolator)haptics->extrapolator.index));
        cJSON_AddBoolToObject(json, "passivity", haptics->passivity.on);
        cJSON_AddNumberToObject(json, "rate_Hz", haptics->rate.si);
    }
    cJSON *list = cJSON_AddArrayToObject(json, "instruments");
    for (int i = 0; i < s->instrument_count; ++i) {
        const app_hand *hand = sim_hand(s, i);
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "mode", modes[s->instrument_def[i].mode]);
        cJSON_AddItemToObject(row, "start_joint", cJSON_CreateDoubleArray(s->start_joint[i], SIM_JOINTS));
        cJSON_AddNumberToObject(row, "tremor_m", hand && hand->tremor.line ? hand->tremor_amplitude.si : 0);
        cJSON_AddBoolToObject(row, "straight", hand && hand->between.index == 1);
        cJSON_AddBoolToObject(row, "repeat", hand && hand->repeat.on);
    }
    return run_report_end(json, &file);
}

int run_hands(sim *s, const run_options *o) {
    char path[1024];
    for (int i = 0; i < s->instrument_count; ++i) {
        snprintf(path, sizeof path, "%.1000s%d.csv", o->hands, i);
        int rc = write_hand(s, i, sim_hand(s, i), path);
        if (rc) return rc;
    }
    snprintf(path, sizeof path, "%.1000s.json", o->hands);
    return write_session(s, path);
}
