#include <sys/random.h>
#include <unistd.h>

#include "app.h"

int64_t app_session(void) {
    uint64_t drawn = 0;
    if (getrandom(&drawn, sizeof drawn, GRND_NONBLOCK) != (ssize_t)sizeof drawn)
        drawn = (uint64_t)app_monotonic_us() * 0x9e3779b97f4a7c15u + (uint64_t)getpid();
    drawn &= INT64_MAX;
    return drawn ? (int64_t)drawn : 1;
}
