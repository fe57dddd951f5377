/* A team: each job has a number, each part a word that holds the number of the last job it was taken for. Whoever moves
 * it from the job before to this one has the part, and says in another word when it is done. A thread that comes late
 * finds its part taken, so what it read about the job, which may be another by then, is not used.
 *
 * A step is a job of some ten microseconds, and a cache line that another core has written takes a tenth of one to
 * come: in the usual case three lines go from one thread to another, the job's there and the word of each part back.
 * Who looks whether others have begun waits a little first. */
#include "base/team.h"
#include "base/wake.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

typedef void part_work(void *context, int32_t part);

typedef struct seat {
    _Alignas(64) atomic_uint_fast32_t taken; /* the last job that this part was taken for, */
    tm_wake wake;
    pthread_t thread;
    tm_team *team;
    int32_t part;
    _Alignas(64) atomic_uint_fast32_t done; /* and that it was done of */
} seat;

struct tm_team {
    tm_pool pool;
    int32_t threads, started;
    seat *seat; /* [threads], the first is the caller's */
    _Alignas(64) atomic_uint_fast32_t job;
    _Atomic(part_work *) work;
    _Atomic(void *) context;
    _Alignas(64) atomic_bool awake;
    atomic_bool over;
    /* The caller's own. */
    bool here;             /* the members are awake */
    bool late;             /* one was kept from running in the middle of its part, since tm_team_begin */
    int32_t pause, longer; /* calls that the caller goes on alone; after the next lateness */
};

/* A pause, and now and then a place for whoever else wants the processor: not within what a step's serial rest takes,
 * or the thread is in the kernel when the next job comes. */
static void wait_a_little(unsigned *turns) {
    enum { TURNS = 512 };
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
    if (++*turns % TURNS == 0) sched_yield();
}

/* Does this part of this job, unless somebody has taken it. */
static void take(const tm_team *team, uint_fast32_t job, int32_t part, part_work *work, void *context) {
    seat *s = team->seat + part;
    uint_fast32_t before = job - 1;
    if (atomic_load_explicit(&s->taken, memory_order_relaxed) != before ||
        !atomic_compare_exchange_strong(&s->taken, &before, job))
        return;
    work(context, part);
    atomic_store_explicit(&s->done, job, memory_order_release);
}

/* Parts [begin, end). */
static void help(tm_team *team, uint_fast32_t job, int32_t begin, int32_t end) {
    part_work *work = atomic_load_explicit(&team->work, memory_order_relaxed);
    void *context = atomic_load_explicit(&team->context, memory_order_relaxed);
    for (int32_t i = begin; i < end; i++) take(team, job, i, work, context);
}

enum { BEFORE_OTHERS = 32 /* pauses, before parts are looked at that others ought to have begun */ };

static void *member(void *of) {
    const seat *own = of;
    tm_team *team = own->team;
    for (uint_fast32_t done = 0;;) {
        tm_wake_wait(&((seat *)of)->wake);
        if (atomic_load(&team->over)) return NULL;
        for (unsigned turns = 0; atomic_load_explicit(&team->awake, memory_order_relaxed);) {
            const uint_fast32_t job = atomic_load_explicit(&team->job, memory_order_acquire);
            if (job != done) { /* its own part: what that reads and writes is in its cache from the job before */
                help(team, job, own->part, own->part + 1);
                done = job;
                turns = 0;
            }
            wait_a_little(&turns);
            if (turns == BEFORE_OTHERS) help(team, job, 1, team->threads);
        }
    }
}

/* When a job began, and when the caller, its own part done, began to wait for others; 0: it has not. */
typedef struct waiting {
    double begin_s, since_s;
} waiting;

/* Waits until every part is done, and does what nobody has begun. On a machine whose cores others want too, a thread
 * may lose its core in the middle of a part, for many times as long as a step takes: where it is late by more than that
 * and by as much as the caller's own part took, the caller goes on alone from then on. The bits are the same. */
static void wait_for(tm_team *team, uint_fast32_t job, int32_t part, waiting *w) {
    static const double LATE_S = 5e-4;
    enum { LOOK = 256 };
    for (unsigned turns = 0; atomic_load_explicit(&team->seat[part].done, memory_order_acquire) != job;) {
        wait_a_little(&turns);
        if (turns % BEFORE_OTHERS == 0) help(team, job, part, part + 1);
        if (turns % LOOK) continue;
        const double now_s = tm_clock_s();
        if (w->since_s == 0) w->since_s = now_s;
        team->late |= now_s - w->since_s > LATE_S && now_s - w->since_s > w->since_s - w->begin_s;
    }
}

void tm_team_run(tm_team *team, part_work *work, void *context) {
    if (!team->here || team->late) {
        for (int32_t part = 0; part < team->threads; part++) work(context, part);
        return;
    }
    const uint_fast32_t job = atomic_load_explicit(&team->job, memory_order_relaxed) + 1;
    waiting w = {.begin_s = tm_clock_s()};
    atomic_store_explicit(&team->work, work, memory_order_relaxed);
    atomic_store_explicit(&team->context, context, memory_order_relaxed);
    atomic_store_explicit(&team->job, job, memory_order_release);
    work(context, 0);
    for (int32_t part = 1; part < team->threads; part++) wait_for(team, job, part, &w);
    if (team->late) atomic_store(&team->awake, false);
}

void tm_team_begin(tm_team *team) {
    team->late = false;
    team->here = team->pause == 0;
    if (!team->here) {
        team->pause--;
        return;
    }
    atomic_store(&team->awake, true);
    for (int32_t i = 1; i < team->threads; i++) tm_wake_post(&team->seat[i].wake);
}

void tm_team_end(tm_team *team) {
    enum { LONGEST = 63 };
    atomic_store(&team->awake, false);
    if (team->late) {
        team->pause = team->longer = team->longer < LONGEST ? 2 * team->longer + 1 : LONGEST;
    } else if (team->here)
        team->longer /= 2;
    team->here = false;
}

/* --- creation --- */

static bool start(tm_team *team) {
    tm_signals before;
    tm_signals_hold(&before);
    bool started = true;
    for (int32_t i = 1; i < team->threads && started; i++) {
        seat *s = team->seat + i;
        s->team = team, s->part = i;
        started = tm_wake_make(&s->wake);
        if (started && pthread_create(&s->thread, NULL, member, s) != 0) {
            tm_wake_free(&s->wake);
            started = false;
        }
        team->started += started;
    }
    tm_signals_give_back(&before);
    return started;
}

tm_team *tm_team_create(int32_t threads) {
    tm_pool pool = {0};
    tm_team *team = TM_TAKE(&pool, tm_team, 1);
    seat *seats = TM_TAKE(&pool, seat, threads);
    if (pool.failed) {
        tm_pool_release(&pool);
        return NULL;
    }
    team->pool = pool;
    team->threads = threads;
    team->seat = seats;
    if (start(team)) return team;
    tm_team_destroy(team);
    return NULL;
}

void tm_team_destroy(tm_team *team) {
    if (!team) return;
    atomic_store(&team->over, true);
    for (int32_t i = 1; i <= team->started; i++) {
        tm_wake_post(&team->seat[i].wake);
        pthread_join(team->seat[i].thread, NULL);
        tm_wake_free(&team->seat[i].wake);
    }
    tm_pool pool = team->pool;
    tm_pool_release(&pool);
}
