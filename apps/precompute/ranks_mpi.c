/* Ranks of Open MPI. If a rank fails, all end; their finished columns stay in the partial file. */
#include <mpi.h>
#include <time.h>

#include "distributed.h"
#include "ranks.h"

const char team_name[] = "tm-precompute-mpi";

static tm_solve_ranks team;

/* Waits at a barrier by polling with pauses, not by spinning: early ranks leave their core to the others. */
static bool meet(void *user) {
    (void)user;
    MPI_Request all;
    int there = 0;
    if (MPI_Ibarrier(MPI_COMM_WORLD, &all) != MPI_SUCCESS) return false;
    while (!there) {
        if (MPI_Test(&all, &there, MPI_STATUS_IGNORE) != MPI_SUCCESS) return false;
        if (!there) nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    return true;
}

const tm_solve_ranks *team_begin(int *count, char ***all) {
    int provided, rank, ranks;
    MPI_Init_thread(count, all, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    team = (tm_solve_ranks){.rank = rank, .count = ranks, .barrier = meet};
    return &team;
}

bool team_share_factor(int32_t threads) {
    team.distributed = shared_begin(threads, &team.user);
    return team.distributed != NULL;
}

void team_gather(double mine, double *all) { MPI_Gather(&mine, 1, MPI_DOUBLE, all, 1, MPI_DOUBLE, 0, MPI_COMM_WORLD); }

int team_end(int code) {
    if (code) MPI_Abort(MPI_COMM_WORLD, code);
    shared_end();
    MPI_Finalize();
    return code;
}
