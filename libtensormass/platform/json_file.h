/* Figures as JSON files, whole or not at all. Link with -lcjson. */
#ifndef TM_JSON_FILE_H
#define TM_JSON_FILE_H

#include <cjson/cJSON.h>

#include "app.h"
#include "result_file.h"

/* Writes `root` (not freed). On failure the message names the path. */
tm_status app_json_write(const char *path, const cJSON *root, tm_error *error);
/* The same into an output that has begun, which ends here. */
bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error);

/* Writes and deletes it. 0 or an exit code, having complained. */
int app_file_end_json(app_file *file, cJSON *report);

#endif
