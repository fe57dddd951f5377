/* Threads that share the work of a step. They sleep but for between tm_team_begin and tm_team_end, where they wait
 * awake. */
#ifndef TM_TEAM_H
#define TM_TEAM_H

#include "base/base_internal.h"

typedef struct tm_team tm_team;

/* `threads` with the caller's, 2 or more. Null: no memory, or no thread to be had. */
tm_team *tm_team_create(int32_t threads);
void tm_team_destroy(tm_team *team); /* may be null */
void tm_team_begin(tm_team *team);
void tm_team_end(tm_team *team);
/* work(context, part) once for every part from 0 to threads-1, part 0 by the caller; returns when all are done. A part
 * that no thread has begun when the caller has done its own is done by the caller too: one that is kept from running
 * holds nothing up. Where one was kept from running in the middle of its part, the caller does all the parts until
 * tm_team_end, and for some calls after. */
void tm_team_run(tm_team *team, void (*work)(void *context, int32_t part), void *context);

#endif
