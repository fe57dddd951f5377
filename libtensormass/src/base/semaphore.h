/* A semaphore for sleeping threads. macOS has none without a name, and Windows has no signals per thread: there a mutex
 * and a condition variable replace it. */
#ifndef TM_SEMAPHORE_H
#define TM_SEMAPHORE_H

#include <pthread.h>
#include <stdbool.h>

#if defined(__APPLE__) || defined(_WIN32)
typedef struct tm_semaphore {
    pthread_mutex_t lock;
    pthread_cond_t posted;
    int count;
} tm_semaphore;
static inline bool tm_semaphore_init(tm_semaphore *w) {
    w->count = 0;
    if (pthread_mutex_init(&w->lock, NULL) != 0) return false;
    if (pthread_cond_init(&w->posted, NULL) == 0) return true;
    pthread_mutex_destroy(&w->lock);
    return false;
}
static inline void tm_semaphore_destroy(tm_semaphore *w) {
    pthread_cond_destroy(&w->posted);
    pthread_mutex_destroy(&w->lock);
}
static inline void tm_semaphore_post(tm_semaphore *w) {
    pthread_mutex_lock(&w->lock);
    w->count++;
    pthread_cond_signal(&w->posted);
    pthread_mutex_unlock(&w->lock);
}
static inline void tm_semaphore_wait(tm_semaphore *w) {
    pthread_mutex_lock(&w->lock);
    while (w->count == 0) pthread_cond_wait(&w->posted, &w->lock);
    w->count--;
    pthread_mutex_unlock(&w->lock);
}
#else
#include <semaphore.h>
typedef sem_t tm_semaphore;
static inline bool tm_semaphore_init(tm_semaphore *w) { return sem_init(w, 0, 0) == 0; }
static inline void tm_semaphore_destroy(tm_semaphore *w) { sem_destroy(w); }
static inline void tm_semaphore_post(tm_semaphore *w) { sem_post(w); }
static inline void tm_semaphore_wait(tm_semaphore *w) {
    while (sem_wait(w) != 0) {
    }
}
#endif

/* Blocks signals while threads are started, so that the program's own threads receive them. */
#ifdef _WIN32
typedef int tm_signals;
static inline void tm_signals_block(tm_signals *before) { *before = 0; }
static inline void tm_signals_restore(const tm_signals *before) { (void)before; }
#else
#include <signal.h>
typedef sigset_t tm_signals;
static inline void tm_signals_block(tm_signals *before) {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, before);
}
static inline void tm_signals_restore(const tm_signals *before) { pthread_sigmask(SIG_SETMASK, before, NULL); }
#endif

#endif
