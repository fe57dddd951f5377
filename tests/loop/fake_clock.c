/* Preloaded by tests: shifts this process's wall clock by the file TM_FAKE_CLOCK (an int64 offset, us, which the
 * test may change), and its monotonic clock by TM_FAKE_MONOTONIC us, as after a restart of the machine. */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t *wall_us;
static int64_t monotonic_us;
static int (*true_gettime)(clockid_t, struct timespec *);
static int (*true_nanosleep)(clockid_t, int, const struct timespec *, struct timespec *);

static __attribute__((constructor)) void begin(void) {
    const char *path = getenv("TM_FAKE_CLOCK"), *monotonic = getenv("TM_FAKE_MONOTONIC");
    *(void **)&true_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    *(void **)&true_nanosleep = dlsym(RTLD_NEXT, "clock_nanosleep");
    if (monotonic) monotonic_us = atoll(monotonic);
    const int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *memory = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *wall_us, PROT_READ, MAP_SHARED, fd, 0);
    if (memory != MAP_FAILED) wall_us = memory;
    if (fd >= 0) close(fd);
}

static void shift(struct timespec *t, int64_t us) {
    const int64_t ns = (int64_t)t->tv_sec * 1000000000 + t->tv_nsec + 1000 * us;
    t->tv_sec = ns / 1000000000;
    t->tv_nsec = ns % 1000000000;
}

static int64_t off_by(clockid_t clock) {
    if (clock == CLOCK_MONOTONIC || clock == CLOCK_MONOTONIC_COARSE || clock == CLOCK_MONOTONIC_RAW)
        return monotonic_us;
    return (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) && wall_us ? *wall_us : 0;
}

int clock_gettime(clockid_t clock, struct timespec *t) {
    if (!true_gettime) begin();
    const int bad = true_gettime(clock, t);
    if (!bad) shift(t, off_by(clock));
    return bad;
}

int gettimeofday(struct timeval *restrict t, void *restrict zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    t->tv_sec = now.tv_sec;
    t->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *t) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (t) *t = now.tv_sec;
    return now.tv_sec;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *wanted, struct timespec *left) {
    struct timespec t = *wanted;
    if (!true_nanosleep) begin();
    if (flags & TIMER_ABSTIME) shift(&t, -off_by(clock));
    return true_nanosleep(clock, flags, &t, left);
}
