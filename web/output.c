/* Writes output files in a browser or under node: under another name, then renamed. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "app.h"

static bool fail(tm_error *error, const char *path, const char *what) {
    if (error) {
        error->status = TM_ERR_FILE;
        error->entity = -1;
        snprintf(error->message, sizeof error->message, "%s: %s: %s; check the folder", path, what, strerror(errno));
    }
    return false;
}
bool app_output_begin(app_output *output, const char *path, tm_error *error) {
    *output = (app_output){.fd = -1};
    if (strlen(path) + 2 > sizeof output->path) {
        errno = ENAMETOOLONG;
        return fail(error, path, "cannot write");
    }
    snprintf(output->path, sizeof output->path, "%s", path);
    snprintf(output->temporary, sizeof output->temporary, "%s~", path);
    output->begun = true;
    return true;
}
FILE *app_output_stream(const app_output *output) { return fopen(output->temporary, "wb"); }
bool app_output_commit(app_output *output, tm_error *error) {
    if (!output->begun) return false;
    output->begun = false;
    return rename(output->temporary, output->path) == 0 || fail(error, output->path, "cannot be put in its place");
}
void app_output_abandon(app_output *output) {
    if (output->begun) unlink(output->temporary);
    output->begun = false;
}
bool app_output_end(app_output *output, FILE *stream, tm_error *error) {
    bool whole = stream && !ferror(stream);
    if (stream && fclose(stream) != 0) whole = false;
    if (whole) return app_output_commit(output, error);
    app_output_abandon(output);
    return fail(error, output->path, "cannot be written to its end");
}
