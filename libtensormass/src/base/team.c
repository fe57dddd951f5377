/* A team: each job has a number, each part a word that holds the number of the last job it was taken for. Whoever moves
 * it from the job before to this one has the part. A thread that comes late finds every part taken, so what it read
 * about the job, which may be another by then, is not used. */
#include "base/team.h"
#include "base/wake.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

typedef void part_work(void *context, int32_t part);

typedef struct seat {
    _Alignas(64) atomic_uint_fast32_t taken; /* the last job that this part was taken for */
    tm_wake wake;
    pthread_t thread;
    tm_team *team;
    int32_t part;
} seat;

struct tm_team {
    tm_pool pool;
    int32_t threads, started;
    seat *seat; /* [threads], the first is the caller's */
    _Alignas(64) atomic_uint_fast32_t job;
    _Atomic(part_work *) work;
    _Atomic(void *) context;
    _Alignas(64) atomic_int left; /* parts of the job that are not done */
    _Alignas(64) atomic_bool awake;
    atomic_bool over;
    /* The caller's own. */
    bool here;             /* the members are awake */
    bool late;             /* one was kept from running in the middle of its part, since tm_team_begin */
    int32_t pause, longer; /* calls that the caller goes on alone; after the next lateness */
};

/* A pause, and now and then a place for whoever else wants the processor. */
static void wait_a_little(unsigned *turns) {
    enum { TURNS = 64 };
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
    if (++*turns % TURNS == 0) sched_yield();
}

/* Does this part of this job, unless somebody has taken it. */
static void take(tm_team *team, uint_fast32_t job, int32_t part, part_work *work, void *context) {
    uint_fast32_t before = job - 1;
    if (!atomic_compare_exchange_strong(&team->seat[part].taken, &before, job)) return;
    work(context, part);
    atomic_fetch_sub(&team->left, 1);
}

/* Its own part first: what that part reads and writes is in its cache from the job before. */
static void help(const seat *own, uint_fast32_t job) {
    tm_team *team = own->team;
    part_work *work = atomic_load(&team->work);
    void *context = atomic_load(&team->context);
    take(team, job, own->part, work, context);
    for (int32_t i = 1; i < team->threads; i++)
        if (i != own->part) take(team, job, i, work, context);
}

static void *member(void *of) {
    const seat *own = of;
    tm_team *team = own->team;
    for (uint_fast32_t done = 0;;) {
        tm_wake_wait(&((seat *)of)->wake);
        if (atomic_load(&team->over)) return NULL;
        for (unsigned turns = 0; atomic_load(&team->awake);) {
            const uint_fast32_t job = atomic_load(&team->job);
            if (job == done) {
                wait_a_little(&turns);
                continue;
            }
            help(own, job);
            done = job;
            turns = 0;
        }
    }
}

/* Waits until every part is done. On a machine whose cores others want too, a thread may lose its core in the middle of
 * a part, for many times as long as a step takes: from then on the caller goes on alone. The bits are the same. */
static void wait_for_all(tm_team *team) {
    static const double LATE_S = 5e-4;
    enum { LOOK = 256 };
    double since_s = 0;
    for (unsigned turns = 0; atomic_load(&team->left) > 0;) {
        wait_a_little(&turns);
        if (turns % LOOK) continue;
        const double now_s = tm_clock_s();
        if (since_s == 0) since_s = now_s;
        team->late |= now_s - since_s > LATE_S;
    }
    if (team->late) atomic_store(&team->awake, false);
}

void tm_team_run(tm_team *team, part_work *work, void *context) {
    if (!team->here || team->late) {
        for (int32_t part = 0; part < team->threads; part++) work(context, part);
        return;
    }
    atomic_store(&team->work, work);
    atomic_store(&team->context, context);
    atomic_store(&team->left, team->threads);
    const uint_fast32_t job = atomic_fetch_add(&team->job, 1) + 1;
    for (int32_t part = 0; part < team->threads; part++) take(team, job, part, work, context);
    wait_for_all(team);
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
