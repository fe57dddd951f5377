/* Figures as JSON files. */
#include <stdio.h>
#include <stdlib.h>

#include "json_file.h"

tm_status app_json_write(const char *path, const cJSON *root, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    char *text = cJSON_Print(root);
    FILE *file = text ? app_output_stream(&output) : NULL;
    bool written = file && fprintf(file, "%s\n", text) > 0;
    if (file && fclose(file) != 0) written = false;
    free(text);
    if (written && app_output_commit(&output, error)) return TM_OK;
    app_output_abandon(&output);
    if (error && !written) {
        error->status = TM_ERR_FILE;
        error->entity = -1;
        snprintf(error->message, sizeof error->message, "%s: cannot write the figures; check the disk", path);
    }
    return TM_ERR_FILE;
}
