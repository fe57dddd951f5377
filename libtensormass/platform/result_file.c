/* Opens output files before a run, and completes them after it. */
#include "result_file.h"

#include <errno.h>
#include <string.h>

int app_file_begin(app_file *file, const char *path) {
    tm_error error = {0};
    if (!path) return 0;
    if (!app_output_begin(&file->output, path, &error)) return app_report(NULL, 0, &error);
    file->stream = app_output_stream(&file->output);
    if (!file->stream) {
        app_output_abandon(&file->output);
        return app_bad_input(path, 0, "cannot be written: %s; choose another folder", strerror(errno));
    }
    file->begun = true;
    return 0;
}

int app_file_end(app_file *file, bool good) {
    tm_error error = {0};
    if (!file->begun) return 0;
    file->begun = false;
    if (good) return app_output_end(&file->output, file->stream, &error) ? 0 : app_report(NULL, 0, &error);
    fclose(file->stream);
    app_output_abandon(&file->output);
    return 0;
}
