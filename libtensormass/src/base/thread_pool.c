/* The thread pool of a step. Each job has a number; each part has a word with the number of the last job for which it
 * was taken. The thread that advances this word to the new job owns the part, and reports completion in another word. A
 * late thread finds its part taken, so it does not use what it read about the job, which may be outdated.
 *
 * A job takes some ten microseconds, and a cache line written by another core takes a tenth of one to arrive. In the
 * usual case three lines pass between threads: the job's one way, the words of each part back. A thread waits a little
 * before it checks whether others have begun. */
#include "base/thread_pool.h"
#include "base/semaphore.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

typedef void part_work(void *context, int32_t part);

typedef struct worker_slot {
    _Alignas(64) atomic_uint_fast32_t taken; /* number of the last job for which this part was taken */
    tm_semaphore wake;
    pthread_t thread;
    tm_thread_pool *pool;
    int32_t part;
    _Alignas(64) atomic_uint_fast32_t done; /* number of the last job completed here */
} worker_slot;

struct tm_thread_pool {
    tm_pool pool;
    int32_t threads, started;
    worker_slot *worker; /* [threads], the first is the caller's */
    _Alignas(64) atomic_uint_fast32_t job;
    _Atomic(part_work *) work;
    _Atomic(void *) context;
    _Alignas(64) atomic_bool awake;
    atomic_bool over;
    /* Used by the caller only. */
    bool here;             /* the workers are awake */
    bool late;             /* a worker was preempted in the middle of its part, since tm_thread_pool_begin */
    int32_t pause, longer; /* calls that the caller does alone; number after the next lateness */
};

/* Pauses, and now and then yields the processor. Not within the time of a step's serial rest: the thread would be in
 * the kernel when the next job comes. */
static void wait_a_little(unsigned *turns) {
    enum { TURNS = 512 };
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
    if (++*turns % TURNS == 0) sched_yield();
}

/* Does this part of this job, unless another thread has taken it. */
static void take(const tm_thread_pool *workers, uint_fast32_t job, int32_t part, part_work *work, void *context) {
    worker_slot *s = workers->worker + part;
    uint_fast32_t before = job - 1;
    if (atomic_load_explicit(&s->taken, memory_order_relaxed) != before ||
        !atomic_compare_exchange_strong(&s->taken, &before, job))
        return;
    work(context, part);
    atomic_store_explicit(&s->done, job, memory_order_release);
}

/* Does the parts [begin, end) that are not taken. */
static void help(tm_thread_pool *workers, uint_fast32_t job, int32_t begin, int32_t end) {
    part_work *work = atomic_load_explicit(&workers->work, memory_order_relaxed);
    void *context = atomic_load_explicit(&workers->context, memory_order_relaxed);
    for (int32_t i = begin; i < end; i++) take(workers, job, i, work, context);
}

enum { BEFORE_OTHERS = 32 /* pauses, before checking for parts that other threads have not begun */ };

static void *run_worker(void *of) {
    const worker_slot *own = of;
    tm_thread_pool *workers = own->pool;
    for (uint_fast32_t done = 0;;) {
        tm_semaphore_wait(&((worker_slot *)of)->wake);
        if (atomic_load(&workers->over)) return NULL;
        for (unsigned turns = 0; atomic_load_explicit(&workers->awake, memory_order_relaxed);) {
            const uint_fast32_t job = atomic_load_explicit(&workers->job, memory_order_acquire);
            if (job != done) { /* its own part: the data are in its cache from the previous job */
                help(workers, job, own->part, own->part + 1);
                done = job;
                turns = 0;
            }
            wait_a_little(&turns);
            if (turns == BEFORE_OTHERS) help(workers, job, 1, workers->threads);
        }
    }
}

/* Times at which a job began, and at which the caller began to wait for others after its own part; 0: it has not. */
typedef struct waiting {
    double begin_s, since_s;
} waiting;

/* Waits until every part is done, and does parts that no thread has begun. Where other programs use the cores, a thread
 * may lose its core in the middle of a part, for the time of many steps. If it is late by more than LATE_S and by as
 * much as the caller's own part took, the caller continues alone. The bits are the same. */
static void wait_for(tm_thread_pool *workers, uint_fast32_t job, int32_t part, waiting *w) {
    static const double LATE_S = 5e-4;
    enum { LOOK = 256 };
    for (unsigned turns = 0; atomic_load_explicit(&workers->worker[part].done, memory_order_acquire) != job;) {
        wait_a_little(&turns);
        if (turns % BEFORE_OTHERS == 0) help(workers, job, part, part + 1);
        if (turns % LOOK) continue;
        const double now_s = tm_clock_s();
        if (w->since_s == 0) w->since_s = now_s;
        workers->late |= now_s - w->since_s > LATE_S && now_s - w->since_s > w->since_s - w->begin_s;
    }
}

void tm_thread_pool_run(tm_thread_pool *workers, part_work *work, void *context) {
    if (!workers->here || workers->late) {
        for (int32_t part = 0; part < workers->threads; part++) work(context, part);
        return;
    }
    const uint_fast32_t job = atomic_load_explicit(&workers->job, memory_order_relaxed) + 1;
    waiting w = {.begin_s = tm_clock_s()};
    atomic_store_explicit(&workers->work, work, memory_order_relaxed);
    atomic_store_explicit(&workers->context, context, memory_order_relaxed);
    atomic_store_explicit(&workers->job, job, memory_order_release);
    work(context, 0);
    for (int32_t part = 1; part < workers->threads; part++) wait_for(workers, job, part, &w);
    if (workers->late) atomic_store(&workers->awake, false);
}

void tm_thread_pool_begin(tm_thread_pool *workers) {
    workers->late = false;
    workers->here = workers->pause == 0;
    if (!workers->here) {
        workers->pause--;
        return;
    }
    atomic_store(&workers->awake, true);
    for (int32_t i = 1; i < workers->threads; i++) tm_semaphore_post(&workers->worker[i].wake);
}

void tm_thread_pool_end(tm_thread_pool *workers) {
    enum { LONGEST = 63 };
    atomic_store(&workers->awake, false);
    if (workers->late) {
        workers->pause = workers->longer = workers->longer < LONGEST ? 2 * workers->longer + 1 : LONGEST;
    } else if (workers->here)
        workers->longer /= 2;
    workers->here = false;
}

/* --- creation --- */

static bool start(tm_thread_pool *workers) {
    tm_signals before;
    tm_signals_block(&before);
    bool started = true;
    for (int32_t i = 1; i < workers->threads && started; i++) {
        worker_slot *s = workers->worker + i;
        s->pool = workers, s->part = i;
        started = tm_semaphore_init(&s->wake);
        if (started && pthread_create(&s->thread, NULL, run_worker, s) != 0) {
            tm_semaphore_destroy(&s->wake);
            started = false;
        }
        workers->started += started;
    }
    tm_signals_restore(&before);
    return started;
}

tm_thread_pool *tm_thread_pool_create(int32_t threads) {
    tm_pool pool = {0};
    tm_thread_pool *workers = TM_ALLOC(&pool, tm_thread_pool, 1);
    worker_slot *worker = TM_ALLOC(&pool, worker_slot, threads);
    if (pool.failed) {
        tm_pool_release(&pool);
        return NULL;
    }
    workers->pool = pool;
    workers->threads = threads;
    workers->worker = worker;
    if (start(workers)) return workers;
    tm_thread_pool_destroy(workers);
    return NULL;
}

void tm_thread_pool_destroy(tm_thread_pool *workers) {
    if (!workers) return;
    atomic_store(&workers->over, true);
    for (int32_t i = 1; i <= workers->started; i++) {
        tm_semaphore_post(&workers->worker[i].wake);
        pthread_join(workers->worker[i].thread, NULL);
        tm_semaphore_destroy(&workers->worker[i].wake);
    }
    tm_pool pool = workers->pool;
    tm_pool_release(&pool);
}
