/* Messages, clock, processors. */
#include "internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

tm_status tms_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...) {
    if (error) {
        error->status = status;
        error->entity = entity;
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
    }
    return status;
}

double tms_clock_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int32_t tms_threads(const tm_solve_def *def) {
    if (def->solver == TM_SOLVER_CHOLESKY && !tms_blas_is_parallel()) return 1;
    if (def->threads > 0) return def->threads;
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    return cores < 1 ? 1 : cores > 64 ? 64 : (int32_t)cores;
}

void tms_bytes_text(int64_t bytes, char text[32]) {
    if (bytes >= 1000000000)
        snprintf(text, 32, "%.1f GB", (double)bytes * 1e-9);
    else if (bytes >= 1000000)
        snprintf(text, 32, "%.0f MB", (double)bytes * 1e-6);
    else
        snprintf(text, 32, "%.0f kB", (double)bytes * 1e-3);
}

bool tms_progress(const tm_solve_def *def, const char *what, double fraction, double seconds_left) {
    return !def->progress || def->progress(def->user, what, fraction, seconds_left);
}

tm_solve_def tm_solve_def_default(void) {
    return (tm_solve_def){
        .cookie = TMS_COOKIE_PROBLEM, .size = sizeof(tm_solve_def), .cg_tolerance = 1e-11, .cg_max_iterations = 20000};
}
