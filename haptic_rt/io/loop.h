/* The Linux loop of haptic-rt and tm-device: absolute deadlines on the monotonic clock; SCHED_FIFO and locked memory if
 * permitted. */
#ifndef HRT_LOOP_H
#define HRT_LOOP_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "histogram.h"

typedef struct hrt_loop {
    /* set before start */
    const char *program;
    int64_t period_ns;
    int priority;      /* SCHED_FIFO 1..99; 0: normal scheduling */
    bool idle_states;  /* allow processor idle states; otherwise a real-time loop disables them while it runs */
    int64_t ticks_max; /* 0: until stopped */
    void (*tick)(void *user, int64_t now_us);
    void (*end)(void *user); /* called in the loop's thread after the last tick; may be null */
    void *user;
    /* results */
    _Atomic bool stop, done;
    _Atomic int64_t ticks, missed;
    hrt_histogram lateness, duration;
    bool real_time; /* SCHED_FIFO was granted */
    int awake_fd;   /* /dev/cpu_dma_latency; while open, idle states are disabled; -1: not open */
    _Atomic int64_t start_us;
    int64_t cpu_us;
    int64_t faults_minor, faults_major; /* page faults of the loop's thread after its first second */
    pthread_t thread;
} hrt_loop;

/* Sets the scheduling of threads created from now on: SCHED_FIFO at `priority` (0: normal). Returns false if not
 * permitted. */
bool hrt_priority(int priority);
/* Locks memory and starts the loop's thread. Reports missing permissions on stderr. Returns false if there is no
 * thread. */
bool hrt_loop_start(hrt_loop *loop);
/* Makes SIGINT and SIGTERM set *stop. */
void hrt_stop_on_signals(_Atomic bool *stop);

#endif
