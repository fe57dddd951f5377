/* Output files that appear whole or not at all, and the progress line. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "app.h"

static bool fail(tm_error *error, const char *what, const char *path) {
    if (error) {
        error->status = TM_ERR_FILE;
        error->entity = -1;
        snprintf(error->message, sizeof error->message, "%s: %s: %s; check the folder and its permissions", path, what,
                 strerror(errno));
    }
    return false;
}

bool app_output_begin(app_output *output, const char *path, tm_error *error) {
    errno = ENAMETOOLONG;
    if ((size_t)snprintf(output->path, sizeof output->path, "%s", path) >= sizeof output->path)
        return fail(error, "cannot write", path);
    snprintf(output->temporary, sizeof output->temporary, "%s.%ld~", output->path, (long)getpid());
    /* Tried now, so that a long run does not end at a folder that is not there. */
    FILE *file = fopen(output->temporary, "wb");
    if (!file) return fail(error, "cannot write", path);
    fclose(file);
    return true;
}

bool app_output_commit(app_output *output, tm_error *error) {
    if (rename(output->temporary, output->path) == 0) return true;
    fail(error, "cannot rename the finished file", output->path);
    app_output_abandon(output);
    return false;
}

void app_output_abandon(app_output *output) { unlink(output->temporary); }

int64_t app_monotonic_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

void app_progress(const char *what, double fraction, bool done) {
    static int64_t last_us, start_us;
    if (!isatty(STDERR_FILENO)) return;
    int64_t now = app_monotonic_us();
    if (!start_us) start_us = now;
    if (done) {
        fprintf(stderr, "\r\033[K");
        start_us = last_us = 0;
    } else if (now - last_us >= 100000) {
        last_us = now;
        double spent_s = (double)(now - start_us) * 1e-6;
        fprintf(stderr, "\r\033[K%s %3.0f %%", what, 100 * fraction);
        if (fraction > 0.01) fprintf(stderr, ", %.0f s left", spent_s * (1 - fraction) / fraction);
    }
    fflush(stderr);
}
