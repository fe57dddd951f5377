/* Figures as JSON files. */
#include <stdio.h>
#include <stdlib.h>

#include "json_file.h"

bool app_json_end(app_output *output, FILE *stream, const cJSON *root, tm_error *error) {
    char *text = stream ? cJSON_Print(root) : NULL;
    if (text) fprintf(stream, "%s\n", text);
    if (stream && !text) fclose(stream);
    bool good = app_output_end(output, text ? stream : NULL, error);
    free(text);
    return good;
}

tm_status app_json_write(const char *path, const cJSON *root, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    return app_json_end(&output, app_output_stream(&output), root, error) ? TM_OK : TM_ERR_FILE;
}

int app_file_end_json(app_file *file, cJSON *report) {
    tm_error error = {0};
    const bool begun = file->begun;
    file->begun = false;
    const bool good = !begun || app_json_end(&file->output, file->stream, report, &error);
    cJSON_Delete(report);
    return good ? 0 : app_report(NULL, 0, &error);
}
