/* Threads that share the work of a step. They sleep but for between tm_thread_pool_begin and tm_thread_pool_end, where
 * they wait awake. */
#ifndef TM_THREAD_POOL_H
#define TM_THREAD_POOL_H

#include "base/base_internal.h"

typedef struct tm_thread_pool tm_thread_pool;

/* `threads` with the caller's, 2 or more. Null: no memory, or no thread to be had. */
tm_thread_pool *tm_thread_pool_create(int32_t threads);
void tm_thread_pool_destroy(tm_thread_pool *workers); /* may be null */
void tm_thread_pool_begin(tm_thread_pool *workers);
void tm_thread_pool_end(tm_thread_pool *workers);
/* work(context, part) once for every part from 0 to threads-1, part 0 by the caller; returns when all are done. A part
 * that no thread has begun when the caller has done its own is done by the caller too: one that is kept from running
 * holds nothing up. Where one was kept from running in the middle of its part, the caller does all the parts until
 * tm_thread_pool_end, and for some calls after. */
void tm_thread_pool_run(tm_thread_pool *workers, void (*work)(void *context, int32_t part), void *context);

#endif
