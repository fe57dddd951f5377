/* What a sleeping thread waits for: a semaphore, and where the system has none without a name (macOS), or signals are
 * no part of threads (Windows), the same of a lock and a condition. */
#ifndef TM_WAKE_H
#define TM_WAKE_H

#include <pthread.h>
#include <stdbool.h>

#if defined(__APPLE__) || defined(_WIN32)
typedef struct tm_wake {
    pthread_mutex_t lock;
    pthread_cond_t posted;
    int count;
} tm_wake;
static inline bool tm_wake_make(tm_wake *w) {
    w->count = 0;
    if (pthread_mutex_init(&w->lock, NULL) != 0) return false;
    if (pthread_cond_init(&w->posted, NULL) == 0) return true;
    pthread_mutex_destroy(&w->lock);
    return false;
}
static inline void tm_wake_free(tm_wake *w) {
    pthread_cond_destroy(&w->posted);
    pthread_mutex_destroy(&w->lock);
}
static inline void tm_wake_post(tm_wake *w) {
    pthread_mutex_lock(&w->lock);
    w->count++;
    pthread_cond_signal(&w->posted);
    pthread_mutex_unlock(&w->lock);
}
static inline void tm_wake_wait(tm_wake *w) {
    pthread_mutex_lock(&w->lock);
    while (w->count == 0) pthread_cond_wait(&w->posted, &w->lock);
    w->count--;
    pthread_mutex_unlock(&w->lock);
}
#else
#include <semaphore.h>
typedef sem_t tm_wake;
static inline bool tm_wake_make(tm_wake *w) { return sem_init(w, 0, 0) == 0; }
static inline void tm_wake_free(tm_wake *w) { sem_destroy(w); }
static inline void tm_wake_post(tm_wake *w) { sem_post(w); }
static inline void tm_wake_wait(tm_wake *w) {
    while (sem_wait(w) != 0) {
    }
}
#endif

/* Signals are the program's, and go to the threads it knows: between the two none is started that would take them. */
#ifdef _WIN32
typedef int tm_signals;
static inline void tm_signals_hold(tm_signals *before) { *before = 0; }
static inline void tm_signals_give_back(const tm_signals *before) { (void)before; }
#else
#include <signal.h>
typedef sigset_t tm_signals;
static inline void tm_signals_hold(tm_signals *before) {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, before);
}
static inline void tm_signals_give_back(const tm_signals *before) { pthread_sigmask(SIG_SETMASK, before, NULL); }
#endif

#endif
