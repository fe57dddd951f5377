/* Ranks of Open MPI. A rank that dies takes the others with it: half a set of columns is of no use, and the old file is
 * untouched. */
#include <mpi.h>

#include "team.h"

const char team_name[] = "tm-precompute-mpi";

static bool send(void *user, int32_t block, const void *data, size_t bytes) {
    (void)user;
    return bytes <= INT32_MAX && MPI_Send(data, (int)bytes, MPI_BYTE, 0, block, MPI_COMM_WORLD) == MPI_SUCCESS;
}

static bool receive(void *user, int32_t rank, int32_t block, void *data, size_t bytes) {
    MPI_Status status;
    int got = 0;
    (void)user;
    if (bytes > INT32_MAX || MPI_Recv(data, (int)bytes, MPI_BYTE, rank, block, MPI_COMM_WORLD, &status) != MPI_SUCCESS)
        return false;
    return MPI_Get_count(&status, MPI_BYTE, &got) == MPI_SUCCESS && (size_t)got == bytes;
}

const tm_solve_team *team_begin(int *count, char ***all) {
    static tm_solve_team team = {.send = send, .receive = receive};
    int provided, rank, ranks;
    MPI_Init_thread(count, all, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    team.rank = rank;
    team.count = ranks;
    return &team;
}

int team_end(int code) {
    if (code) MPI_Abort(MPI_COMM_WORLD, code);
    MPI_Finalize();
    return code;
}
