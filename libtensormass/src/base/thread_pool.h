/* Threads that share the work of a step. They sleep, except between tm_thread_pool_begin and tm_thread_pool_end, where
 * they spin. */
#ifndef TM_THREAD_POOL_H
#define TM_THREAD_POOL_H

#include "base/base_internal.h"

typedef struct tm_thread_pool tm_thread_pool;

/* `threads` includes the caller's, 2 or more. Null: no memory or no thread available. */
tm_thread_pool *tm_thread_pool_create(int32_t threads);
void tm_thread_pool_destroy(tm_thread_pool *workers); /* may be null */
void tm_thread_pool_begin(tm_thread_pool *workers);
void tm_thread_pool_end(tm_thread_pool *workers);
/* Calls work(context, part) once for every part from 0 to threads-1, part 0 on the caller's thread; returns when all
 * are done. The caller also does parts that no thread has begun when its own is done: a preempted thread delays
 * nothing. If a thread is preempted in the middle of its part, the caller does all parts until tm_thread_pool_end, and
 * for some calls after. */
void tm_thread_pool_run(tm_thread_pool *workers, void (*work)(void *context, int32_t part), void *context);

#endif
