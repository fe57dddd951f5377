/* Build without a distributed factor. */
#include "distributed.h"

const tm_solve_distributed *shared_begin(int32_t threads, void **user) {
    (void)threads;
    (void)user;
    return NULL;
}

void shared_end(void) {}
