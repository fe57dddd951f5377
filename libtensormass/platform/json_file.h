/* Writes figures as JSON files, complete or not at all. Link with -lcjson. */
#ifndef TM_JSON_FILE_H
#define TM_JSON_FILE_H

#include <cjson/cJSON.h>

#include "app.h"
#include "result_file.h"

/* Writes `root` (not freed). On failure the message names the path. */
tm_status app_json_write(const char *path, const cJSON *root, tm_error *error);
/* The same; returns 0 or an exit code after an error message. `path` null: does nothing. */
int app_json_save(const char *path, const cJSON *root);
/* The same into an output that has begun, and ends it. */
bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error);

/* Reads a JSON file; returns null if it cannot be read or parsed. */
cJSON *app_json_read(const char *path);

/* Adds members. "NAME %g NAME %d ..." gives their names and types: %g a double, %f a double that is omitted unless
 * finite, %d an int, %s a string, %hhd a bool. Appends them to an array as a new object. Returns the object with the
 * members. */
cJSON *app_json_add(cJSON *to, const char *members, ...) __attribute__((format(printf, 2, 3)));

/* Writes and deletes the report. Returns 0 or an exit code after an error message. */
int app_file_end_json(app_file *file, cJSON *report);

#endif
