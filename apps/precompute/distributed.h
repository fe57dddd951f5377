/* A factor distributed over the ranks, computed by MUMPS if the program was built with it. */
#ifndef TM_PRECOMPUTE_DISTRIBUTED_H
#define TM_PRECOMPUTE_DISTRIBUTED_H

#include "tensormass_solve.h"

/* Returns the functions of the distributed factor, or null if this build has none. Pass `user` to its functions. */
const tm_solve_distributed *shared_begin(int32_t threads, void **user);
/* Frees the factor; does nothing without one. */
void shared_end(void);

#endif
