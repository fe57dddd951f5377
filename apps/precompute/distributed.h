/* A factor in pieces over the ranks: by MUMPS, where the program was built with it. */
#ifndef TM_PRECOMPUTE_DISTRIBUTED_H
#define TM_PRECOMPUTE_DISTRIBUTED_H

#include "tensormass_solve.h"

/* Null: built without. `user` is what its functions want. */
const tm_solve_distributed *shared_begin(int32_t threads, void **user);
/* Frees the factor; without one it does nothing. */
void shared_end(void);

#endif
