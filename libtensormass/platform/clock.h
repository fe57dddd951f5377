/* System clocks, header only: libraries that do not link platform use them too. */
#ifndef APP_CLOCK_H
#define APP_CLOCK_H

#include <stdint.h>
#include <time.h>

/* CLOCK_MONOTONIC, CLOCK_PROCESS_CPUTIME_ID and so on. */
static inline int64_t app_clock_ns(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}
static inline int64_t app_clock_us(clockid_t clock) { return app_clock_ns(clock) / 1000; }
static inline double app_clock_s(clockid_t clock) { return 1e-9 * (double)app_clock_ns(clock); }
static inline double app_seconds(void) { return app_clock_s(CLOCK_MONOTONIC); }
static inline int64_t app_monotonic_us(void) { return app_clock_us(CLOCK_MONOTONIC); }
static inline int64_t app_monotonic_ns(void) { return app_clock_ns(CLOCK_MONOTONIC); }

#endif
