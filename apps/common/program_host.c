#include "program_host.h"

#include <math.h>
#include <stdlib.h>

static void print(void *user, const tm_diagnostic *d) {
    (void)user;
    const char *const between = *d->remedy ? "; " : "", *const file = *d->file ? d->file : NULL;
    if (d->severity == TM_REMARK)
        app_remark("%s%s%s%s%s", d->file, file ? ": " : "", d->what, between, d->remedy);
    else
        app_bad_input(file, d->line, "%s%s%s%s", d->severity == TM_WARNING ? "warning: " : "", d->what, between,
                      d->remedy);
}

static double allowed_until_s = INFINITY, beyond_s;

void app_solve_allow(double seconds) {
    allowed_until_s = 1e-6 * (double)app_monotonic_us() + seconds;
    beyond_s = 0;
}

double app_solve_beyond(void) { return beyond_s; }

bool app_solve_progress(void *user, const char *what, double fraction, double seconds_left) {
    (void)user;
    app_progress(what, fraction, fraction >= 1);
    const double left_s = fmax(seconds_left, 0), end_s = 1e-6 * (double)app_monotonic_us() + left_s;
    if (end_s > allowed_until_s) beyond_s = fmax(left_s, 1e-6);
    return !app_interrupted() && end_s <= allowed_until_s;
}

static bool is_interrupted(void *user) {
    (void)user;
    return app_interrupted() != 0;
}

/* Opens a module. The module solve has its own threads, and uses one thread of OpenBLAS in each. */
static void *open_module(const char *name, tm_error *error) {
    setenv("OPENBLAS_NUM_THREADS", "1", 0);
    return app_module(name, error);
}

const app_host *app_program_host(void) {
    static tm_diagnostics printed = {.on_diagnostic = print};
    static const app_host host = {
        .diagnostics = &printed, .progress = app_solve_progress, .stop = is_interrupted, .module = open_module};
    return &host;
}
