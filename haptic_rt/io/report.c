#include "report.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "log_line.h"

void hrt_report_loop(cJSON *json, const hrt_loop *loop) {
    cJSON_AddNumberToObject(json, "ticks", (double)loop->ticks);
    cJSON_AddNumberToObject(json, "missed_ticks", (double)loop->missed);
    cJSON_AddNumberToObject(json, "start_us", (double)loop->start_us); /* of the clock that TOOL messages carry */
    cJSON_AddBoolToObject(json, "real_time", loop->real_time);
    cJSON_AddBoolToObject(json, "idle_states_held_off", loop->awake_fd >= 0);
    cJSON_AddNumberToObject(json, "page_faults_minor", (double)loop->faults_minor);
    cJSON_AddNumberToObject(json, "page_faults_major", (double)loop->faults_major);
    cJSON_AddNumberToObject(json, "cpu_us", (double)loop->cpu_us);
    hrt_report_quantiles(json, "lateness_us", &loop->lateness);
    hrt_report_quantiles(json, "duration_us", &loop->duration);
}

static int64_t strange(const hrt_live_refused *r) { return r->packets.malformed + r->packets.oversized; }

void hrt_report_refused(cJSON *json, hrt_live *live) {
    const hrt_live_refused now = hrt_live_refusals(live);
    cJSON *row = cJSON_AddObjectToObject(json, "refused");
    cJSON_AddNumberToObject(row, "malformed", (double)now.malformed);
    cJSON_AddNumberToObject(row, "forged", (double)now.forged);
    cJSON_AddNumberToObject(row, "commands", (double)now.commands);
    cJSON_AddNumberToObject(row, "packets", (double)strange(&now));
    cJSON_AddNumberToObject(row, "foreign", (double)now.packets.foreign);
}

void hrt_say_refused(const char *program, hrt_live *live, hrt_live_refused *told) {
    const hrt_live_refused now = hrt_live_refusals(live);
    if (memcmp(&now, told, sizeof now) == 0) return;
    app_say(
        "%s: refused since the last such line: %lld messages not whole, %lld without the key's tag or heard before, "
        "%lld commands, %lld packets that are none of ours, %lld of other machines",
        program, (long long)(now.malformed - told->malformed), (long long)(now.forged - told->forged),
        (long long)(now.commands - told->commands), (long long)(strange(&now) - strange(told)),
        (long long)(now.packets.foreign - told->packets.foreign));
    *told = now;
}

void hrt_report_can(cJSON *json, const hrt_bus *bus, const hrt_can_counters *can, double seconds) {
    cJSON *row = cJSON_AddObjectToObject(json, "can");
    const struct {
        const char *name;
        double value;
    } figures[] = {{"tx", (double)bus->tx},
                   {"rx", (double)bus->rx},
                   {"dropped", (double)bus->dropped},
                   {"lost", can->lost},
                   {"repeated", can->repeated},
                   {"corrupt", can->corrupt},
                   {"foreign", can->foreign},
                   {"error_frames", can->error},
                   {"bus_off", can->bus_off},
                   {"command_gaps", can->command_gaps},
                   {"load_percent", seconds > 0.0 ? 100.0 * (double)bus->bits / (1.0e6 * seconds) : 0.0}};
    for (size_t i = 0; i < sizeof figures / sizeof *figures; i++)
        cJSON_AddNumberToObject(row, figures[i].name, figures[i].value);
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
    app_bad_input(option, 0, "'%s' is no number of %g..%g; give one", text, low, high);
    return false;
}
