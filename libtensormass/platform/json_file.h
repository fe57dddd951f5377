/* Figures as JSON files, whole or not at all. Link with -lcjson. */
#ifndef TM_JSON_FILE_H
#define TM_JSON_FILE_H

#include <cjson/cJSON.h>

#include "app.h"

/* Writes `root` (not freed). On failure the message names the path. */
tm_status app_json_write(const char *path, const cJSON *root, tm_error *error);
/* The same into an output that has begun, which ends here. */
bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error);

#endif
