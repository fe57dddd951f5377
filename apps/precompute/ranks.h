/* The processes that share the columns: this one alone, or Open MPI's ranks (another build of the same program). */
#ifndef TM_PRECOMPUTE_RANKS_H
#define TM_PRECOMPUTE_RANKS_H

#include "tensormass_solve.h"

extern const char team_name[]; /* of the program */
/* Null: alone. */
const tm_solve_ranks *team_begin(int *count, char ***all);
/* From here on the team shares one factor, with so many threads a rank. False: this build cannot. */
bool team_share_factor(int32_t threads);
/* Rank 0 gets each rank's `mine`, in all [count]; what the others get is unchanged. */
void team_gather(double mine, double *all);
/* Ends all ranks, at once when one has failed. Returns `code`. */
int team_end(int code);

#endif
