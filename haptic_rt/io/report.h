/* Statistics of a loop as JSON and as text; shared by haptic-rt and tm-device. */
#ifndef HRT_REPORT_H
#define HRT_REPORT_H

#include <stdio.h>

#include "app.h"
#include "bus.h"
#include "can/codec.h"
#include "drive.h"
#include "loop.h"
#include "network_peer.h"

struct cJSON;
void hrt_report_loop(struct cJSON *json, const hrt_loop *loop);
/* Adds the rejected LCM messages to the report. */
void hrt_report_refused(struct cJSON *json, hrt_live *live);
/* Logs new rejections since the last logged ones on stderr. Call it at most once a second. */
void hrt_log_refused(const char *program, hrt_live *live, hrt_live_refused *told);
void hrt_report_drive(struct cJSON *json, hrt_drive *drive);
void hrt_report_can(struct cJSON *json, const hrt_bus *bus, const hrt_can_counters *can, double seconds);
/* Begins an output file before the run, so that a wrong path is reported at once. The file appears complete or not at
 * all. `path` null: no file. Returns 0 or an exit code. */
int hrt_output_begin(app_output *output, const char *path);
/* Closes `file` (null: opening failed) and publishes it. Returns 0 or an exit code. */
int hrt_output_end(app_output *output, FILE *file);
/* Writes and frees `json`, and publishes the file. Returns 0 or an exit code. */
int hrt_report_write(struct cJSON *json, app_output *output);
/* Parses an option's number. Returns false after a message if it is invalid; the exit code is then 2. */
bool hrt_option_number(const char *option, const char *text, double low, double high, double *value);

#endif
