/* Figures as JSON files, whole or not at all. Link with -lcjson. */
#ifndef TM_JSON_FILE_H
#define TM_JSON_FILE_H

#include <cjson/cJSON.h>

#include "app.h"
#include "result_file.h"

/* Writes `root` (not freed). On failure the message names the path. */
tm_status app_json_write(const char *path, const cJSON *root, tm_error *error);
/* The same: 0 or an exit code, having complained. `path` null: nobody asked. */
int app_json_save(const char *path, const cJSON *root);
/* The same into an output that has begun, which ends here. */
bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error);

/* The whole file; null where it cannot be read or is no JSON. */
cJSON *app_json_read(const char *path);

/* Adds members: "NAME %g NAME %d ..." says their names and what the arguments are: %g a double, %f one that is left out
 * where it is not finite, %d an int, %s a string, %hhd a bool. To an array it adds them as a new object. Returns what
 * has the members. */
cJSON *app_json_add(cJSON *to, const char *members, ...) __attribute__((format(printf, 2, 3)));

/* Writes and deletes it. 0 or an exit code, having complained. */
int app_file_end_json(app_file *file, cJSON *report);

#endif
