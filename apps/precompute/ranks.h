/* The processes that share the columns: this process alone, or the ranks of Open MPI (another build of the same
 * program). */
#ifndef TM_PRECOMPUTE_RANKS_H
#define TM_PRECOMPUTE_RANKS_H

#include "tensormass_solve.h"

extern const char team_name[]; /* name of the program */
/* Returns the ranks, or null if this process is alone. */
const tm_solve_ranks *team_begin(int *count, char ***all);
/* Makes the ranks share one factor from now on, with this many threads per rank. Returns false if this build cannot. */
bool team_share_factor(int32_t threads);
/* Gathers each rank's `mine` in all[count] on rank 0. On other ranks `all` is unchanged. */
void team_gather(double mine, double *all);
/* Ends all ranks, at once if one has failed. Returns `code`. */
int team_end(int code);

#endif
