/* Prints the progress line, and draws session numbers. */
#include "app.h"

#include <stdarg.h>
#include <stdio.h>
#include <sys/random.h>
#include <unistd.h>

#include "log_line.h"

static bool quiet;
void app_be_quiet(void) { quiet = true; }
bool app_is_quiet(void) { return quiet; }

void app_remark(const char *format, ...) {
    if (quiet) return;
    va_list arguments;
    va_start(arguments, format);
    app_say_list(format, arguments);
    va_end(arguments);
}

void app_progress(const char *what, double fraction, bool done) {
    static int64_t last_us, start_us;
    if (quiet || !isatty(STDERR_FILENO)) return;
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

int64_t app_session(void) {
    uint64_t drawn = 0;
    if (getrandom(&drawn, sizeof drawn, GRND_NONBLOCK) != (ssize_t)sizeof drawn)
        drawn = (uint64_t)app_monotonic_us() * 0x9e3779b97f4a7c15u + (uint64_t)getpid();
    drawn &= INT64_MAX;
    return drawn ? (int64_t)drawn : 1;
}
