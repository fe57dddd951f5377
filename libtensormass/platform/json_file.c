/* Reads and writes figures as JSON files. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"

bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error) {
    char *text = stream ? cJSON_Print(root) : NULL;
    if (text) fprintf(stream, "%s\n", text);
    if (stream && !text) fclose(stream);
    bool good = app_output_end(output, text ? stream : NULL, error);
    free(text);
    return good;
}

cJSON *app_json_read(const char *path) {
    char *text = NULL;
    size_t room = 0;
    FILE *file = fopen(path, "rb");
    const ssize_t length = file ? getdelim(&text, &room, 0, file) : -1;
    cJSON *root = length > 0 ? cJSON_Parse(text) : NULL;
    if (file) fclose(file);
    free(text);
    return root;
}

tm_status app_json_write(const char *path, const cJSON *root, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    return app_json_end(&output, app_output_stream(&output), root, error) ? TM_OK : TM_ERR_FILE;
}

cJSON *app_json_add(cJSON *to, const char *members, ...) {
    cJSON *out = cJSON_IsArray(to) ? cJSON_CreateObject() : to;
    if (out != to) cJSON_AddItemToArray(to, out);
    va_list value;
    va_start(value, members);
    for (const char *c = members; *c; c += strcspn(c, " "), c += *c == ' ') {
        char name[64];
        double number = 0;
        snprintf(name, sizeof name, "%.*s", (int)strcspn(c, " "), c);
        c = strchr(c, '%') + 1;
        if (*c == 'g' || *c == 'f') number = va_arg(value, double);
        if (*c == 'd') number = va_arg(value, int);
        if (*c == 's')
            cJSON_AddStringToObject(out, name, va_arg(value, const char *));
        else if (*c == 'h')
            cJSON_AddBoolToObject(out, name, va_arg(value, int));
        else if (*c != 'f' || isfinite(number))
            cJSON_AddNumberToObject(out, name, number);
    }
    va_end(value);
    return out;
}

int app_json_save(const char *path, const cJSON *root) {
    tm_error error = {0};
    return path && app_json_write(path, root, &error) ? app_report(NULL, 0, &error) : 0;
}

int app_file_end_json(app_file *file, cJSON *report) {
    tm_error error = {0};
    const bool begun = file->begun;
    file->begun = false;
    const bool good = !begun || app_json_end(&file->output, file->stream, report, &error);
    cJSON_Delete(report);
    return good ? 0 : app_report(NULL, 0, &error);
}
