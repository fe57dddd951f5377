/* Figures of a loop as JSON and as lines; shared by haptic-rt and tm-device. */
#ifndef HRT_REPORT_H
#define HRT_REPORT_H

#include <stdio.h>

#include "app.h"
#include "bus.h"
#include "can/codec.h"
#include "loop.h"
#include "network_peer.h"

struct cJSON;
void hrt_report_loop(struct cJSON *json, const hrt_loop *loop);
/* What was refused of what came over LCM. */
void hrt_report_refused(struct cJSON *json, hrt_live *live);
/* The same on stderr, as what is new since the last call that said something; call it once a second at most. */
void hrt_log_refused(const char *program, hrt_live *live, hrt_live_refused *told);
void hrt_report_can(struct cJSON *json, const hrt_bus *bus, const hrt_can_counters *can, double seconds);
/* Output files are begun before the run, so that a wrong path is told at once, and appear whole or not at all. `path`
 * null: nothing. 0 or an exit code. */
int hrt_output_begin(app_output *output, const char *path);
/* Closes `file` (null: it could not be opened) and puts it in place. */
int hrt_output_end(app_output *output, FILE *file);
/* Writes, frees `json`, puts the file in place. */
int hrt_report_write(struct cJSON *json, app_output *output);
/* A number of an option, or exit code 2 after a message. */
bool hrt_option_number(const char *option, const char *text, double low, double high, double *value);

#endif
