/* Writes the statistics of a loop as JSON and as text. */
#include "report.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "log_line.h"

void hrt_report_loop(cJSON *json, const hrt_loop *loop) {
    /* start_us: on the clock of TOOL messages */
    app_json_add(json,
                 "ticks %g missed_ticks %g start_us %g real_time %hhd idle_states_held_off %hhd page_faults_minor %g "
                 "page_faults_major %g cpu_us %g",
                 (double)loop->ticks, (double)loop->missed, (double)loop->start_us, loop->real_time,
                 loop->awake_fd >= 0, (double)loop->faults_minor, (double)loop->faults_major, (double)loop->cpu_us);
    hrt_report_quantiles(json, "lateness_us", &loop->lateness);
    hrt_report_quantiles(json, "duration_us", &loop->duration);
}

static int64_t strange(const hrt_live_refused *r) { return r->packets.malformed + r->packets.oversized; }

void hrt_report_refused(cJSON *json, hrt_live *live) {
    const hrt_live_refused now = hrt_live_refusals(live);
    app_json_add(cJSON_AddObjectToObject(json, "refused"), "malformed %g forged %g commands %g packets %g foreign %g",
                 (double)now.malformed, (double)now.forged, (double)now.commands, (double)strange(&now),
                 (double)now.packets.foreign);
}

void hrt_log_refused(const char *program, hrt_live *live, hrt_live_refused *told) {
    const hrt_live_refused now = hrt_live_refusals(live);
    if (memcmp(&now, told, sizeof now) == 0) return;
    app_say("%s: refused since the last such message: %lld incomplete messages, %lld without the key's tag or "
            "repeated, %lld commands, %lld packets of other programs, %lld of other machines",
            program, (long long)(now.malformed - told->malformed), (long long)(now.forged - told->forged),
            (long long)(now.commands - told->commands), (long long)(strange(&now) - strange(told)),
            (long long)(now.packets.foreign - told->packets.foreign));
    *told = now;
}

void hrt_report_can(cJSON *json, const hrt_bus *bus, const hrt_can_counters *can, double seconds) {
    app_json_add(cJSON_AddObjectToObject(json, "can"),
                 "tx %g rx %g dropped %g lost %g repeated %g corrupt %g foreign %g error_frames %g bus_off %g "
                 "command_gaps %g load_percent %g",
                 (double)bus->tx, (double)bus->rx, (double)bus->dropped, (double)can->lost, (double)can->repeated,
                 (double)can->corrupt, (double)can->foreign, (double)can->error, (double)can->bus_off,
                 (double)can->command_gaps, seconds > 0.0 ? 100.0 * (double)bus->bits / (1.0e6 * seconds) : 0.0);
}

void hrt_report_drive(cJSON *json, hrt_drive *d) {
    app_json_add(cJSON_AddObjectToObject(json, "drive"), "states %g refused %g commands %g withheld %g connections %g",
                 (double)atomic_load(&d->states), (double)atomic_load(&d->refused), (double)atomic_load(&d->commands),
                 (double)atomic_load(&d->withheld), (double)atomic_load(&d->session));
}

int hrt_output_begin(app_output *output, const char *path) {
    tm_error error = {.status = TM_OK};
    if (!path || app_output_begin(output, path, &error)) return APP_DONE;
    return app_report(NULL, 0, &error);
}

int hrt_output_end(app_output *output, FILE *file) {
    tm_error error = {.status = TM_OK};
    return app_output_end(output, file, &error) ? APP_DONE : (app_report(NULL, 0, &error), APP_FAILED);
}

int hrt_report_write(cJSON *json, app_output *output) {
    tm_error error = {.status = TM_OK};
    const bool good = app_json_end(output, app_output_stream(output), json, &error);
    cJSON_Delete(json);
    return good ? APP_DONE : (app_report(NULL, 0, &error), APP_FAILED);
}

bool hrt_option_number(const char *option, const char *text, double low, double high, double *value) {
    char *end;
    *value = strtod(text, &end);
    if (end != text && *end == 0 && *value >= low && *value <= high) return true;
    app_bad_input(option, 0, "'%s' is not a number from %g to %g; give one", text, low, high);
    return false;
}
