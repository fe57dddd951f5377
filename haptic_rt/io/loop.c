/* The Linux loop: deadlines, scheduling, locked memory, idle states, signals. */
#include "loop.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "log_line.h"

enum { STACK_TOUCHED = 256 * 1024 };

bool hrt_priority(int priority) {
    const struct sched_param p = {.sched_priority = priority};
    return sched_setscheduler(0, priority > 0 ? SCHED_FIFO : SCHED_OTHER, &p) == 0;
}

static void sleep_until(int64_t ns) {
    const struct timespec t = {ns / 1000000000, ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
    }
}

/* Page-faults the stack that the ticks will use. */
static __attribute__((noinline)) void touch_stack(void) {
    volatile char page[STACK_TOUCHED];
    for (size_t i = 0; i < sizeof page; i += 1024) page[i] = 0;
}

static void count_faults(int64_t *minor, int64_t *major) {
    struct rusage usage;
    getrusage(RUSAGE_THREAD, &usage);
    *minor = usage.ru_minflt;
    *major = usage.ru_majflt;
}

static void *run(void *user) {
    hrt_loop *l = user;
    l->real_time = l->priority > 0 && hrt_priority(l->priority);
    touch_stack();
    const int64_t start_ns = app_monotonic_ns(), warm_ticks = 1000000000 / l->period_ns;
    int64_t next_ns = start_ns + l->period_ns, minor = 0, major = 0;
    l->start_us = start_ns / 1000;
    while (!atomic_load(&l->stop) && (l->ticks_max == 0 || atomic_load(&l->ticks) < l->ticks_max)) {
        sleep_until(next_ns);
        const int64_t begin_ns = app_monotonic_ns();
        l->tick(l->user, begin_ns / 1000);
        const int64_t end_ns = app_monotonic_ns();
        hrt_histogram_add(&l->lateness, begin_ns - next_ns);
        hrt_histogram_add(&l->duration, end_ns - begin_ns);
        if (atomic_fetch_add(&l->ticks, 1) == warm_ticks) count_faults(&minor, &major);
        next_ns += l->period_ns;
        if (end_ns >= next_ns) { /* late ticks are counted as missed, not repeated */
            const int64_t lost = (end_ns - next_ns) / l->period_ns + 1;
            atomic_fetch_add(&l->missed, lost);
            next_ns += lost * l->period_ns;
        }
    }
    if (l->end) l->end(l->user);
    if (atomic_load(&l->ticks) > warm_ticks) {
        count_faults(&l->faults_minor, &l->faults_major);
        l->faults_minor -= minor;
        l->faults_major -= major;
    }
    l->cpu_us = app_clock_us(CLOCK_THREAD_CPUTIME_ID);
    atomic_store(&l->done, true);
    return NULL;
}

/* Disables deep idle states, which delay wake-up: the kernel's PM QoS interface does so while the file is open
 * (Documentation/power/pm_qos_interface.rst). Kernels without idle states have no such file. */
static void hold_idle_states(hrt_loop *l) {
    const int32_t latency_us = 0;
    l->awake_fd = -1;
    if (l->idle_states || l->priority == 0) return;
    const int fd = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    if (fd >= 0 && write(fd, &latency_us, sizeof latency_us) == (ssize_t)sizeof latency_us) {
        l->awake_fd = fd;
        return;
    }
    if (errno != ENOENT)
        app_say(
            "%s: idle states cannot be disabled (/dev/cpu_dma_latency: %s), so an idle processor wakes late; permit this user to write the file, or add --idle-states",
            l->program, strerror(errno));
    if (fd >= 0) close(fd);
}

bool hrt_loop_start(hrt_loop *l) {
    hold_idle_states(l);
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
        app_say(
            "%s: memory is not locked (%s), so page faults may delay a tick; raise `ulimit -l` or run with CAP_IPC_LOCK",
            l->program, strerror(errno));
    if (l->priority > 0) {
        const struct sched_param p = {.sched_priority = l->priority};
        /* Tried on this thread first, so that the warning comes from here and not from the loop. */
        struct sched_param old;
        const int policy = sched_getscheduler(0);
        sched_getparam(0, &old);
        if (sched_setscheduler(0, SCHED_FIFO, &p) != 0)
            app_say(
                "%s: no SCHED_FIFO (%s), so the loop runs at normal priority and will be late on a busy machine; run with CAP_SYS_NICE or set RLIMIT_RTPRIO",
                l->program, strerror(errno));
        else
            sched_setscheduler(0, policy, &old);
    }
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, 4 * STACK_TOUCHED);
    int error = pthread_create(&l->thread, &attributes, run, l);
    if (error == EAGAIN) { /* a small lock limit leaves no memory for a stack */
        munlockall();
        app_say("%s: memory is not locked, as the limit is too small; raise `ulimit -l` or run with CAP_IPC_LOCK",
                l->program);
        error = pthread_create(&l->thread, &attributes, run, l);
    }
    pthread_attr_destroy(&attributes);
    /* Locks present memory, the loop's stack included, but not later allocations: received data must not make this
     * process lock memory. */
    if (mlockall(MCL_CURRENT) != 0) munlockall();
    if (error) app_say("%s: cannot start the loop's thread (%s); close other programs", l->program, strerror(error));
    return error == 0;
}

static _Atomic bool *signal_stop;
static void on_signal(int number) {
    (void)number;
    atomic_store(signal_stop, true);
    signal(SIGINT, SIG_DFL); /* a second signal ends the program at once; the device's watchdog then stops the motors */
    signal(SIGTERM, SIG_DFL);
}

void hrt_stop_on_signals(_Atomic bool *stop) {
    signal_stop = stop;
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    action.sa_flags =
        (int)SA_RESETHAND; /* a second signal ends it at once; the device's watchdog then stops the motors */
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}
