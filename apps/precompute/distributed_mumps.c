/* MUMPS: LDL^T of a symmetric positive definite matrix, distributed over the ranks of MPI_COMM_WORLD. Each rank passes
 * a share of the entries. Right-hand sides are unit vectors, so MUMPS prunes its trees. The solution stays distributed
 * like the factor; each rank sends the others the rows that they requested. */
#include <dmumps_c.h>
#include <mpi.h>
#include <stdlib.h>
#include <string.h>

#include "distributed.h"

/* MUMPS numbers its controls from 1, as its guide does. */
#define ICNTL(i) icntl[(i)-1]
#define INFO(i) info[(i)-1]
#define INFOG(i) infog[(i)-1]
enum { BEGIN = -1, END = -2, ANALYSE = 1, FACTORISE = 2, SOLVE = 3, MORE_ROOM_PERCENT = 30 };

static struct {
    DMUMPS_STRUC_C m;
    int rank, ranks;
    bool begun;
    int32_t n, *slot; /* [n] index of a row among the requested rows, or -1 */
} s;

static int64_t job(int what) {
    s.m.job = what;
    dmumps_c(&s.m);
    return s.m.INFOG(1);
}

/* --- factor --- */

/* Passes this rank's columns of the lower triangle, distributed cyclically. */
static bool hand_in(const int32_t *begin, const int32_t *row, const double *value) {
    int64_t count = 0, at = 0;
    for (int32_t j = s.rank; j < s.n; j += s.ranks) count += begin[j + 1] - begin[j];
    s.m.nnz_loc = count;
    s.m.irn_loc = malloc(sizeof *s.m.irn_loc * (size_t)(count + 1));
    s.m.jcn_loc = malloc(sizeof *s.m.jcn_loc * (size_t)(count + 1));
    s.m.a_loc = malloc(sizeof *s.m.a_loc * (size_t)(count + 1));
    if (!s.m.irn_loc || !s.m.jcn_loc || !s.m.a_loc) return false;
    for (int32_t j = s.rank; j < s.n; j += s.ranks)
        for (int32_t k = begin[j]; k < begin[j + 1]; k++, at++) {
            s.m.irn_loc[at] = row[k] + 1;
            s.m.jcn_loc[at] = j + 1;
            s.m.a_loc[at] = value[k];
        }
    return true;
}

static void take_back(void) {
    free(s.m.irn_loc);
    free(s.m.jcn_loc);
    free(s.m.a_loc);
    s.m.irn_loc = s.m.jcn_loc = NULL;
    s.m.a_loc = NULL;
}

static tm_status fail(tm_error *error, int64_t code) {
    const bool memory = code == -9 || code == -8 || code == -13 || code == -7 || code == -19;
    const bool floats = code == -10 || code == 0; /* 0: negative pivots */
    static const char *const what[3] = {
        "no memory for this rank's part of the factor; use more ranks, on more machines",
        "the tissue can move without force; support it, and look for parts connected by one vertex or one edge",
        "MUMPS failed"};
    return tm_fail(error,
                   memory   ? TM_ERR_MEMORY
                   : floats ? TM_ERR_SUPPORT
                            : TM_ERR_CONVERGENCE,
                   -1, "%s (MUMPS INFOG(1) = %lld, INFOG(2) = %d)",
                   what[memory   ? 0
                        : floats ? 1
                                 : 2],
                   (long long)code, s.m.INFOG(2));
}

/* Computes the factor. All ranks return the same status: INFOG is equal on all. */
static tm_status factor(void *user, int32_t n, const int32_t *begin, const int32_t *row, const double *value,
                        int64_t *bytes, tm_error *error) {
    (void)user;
    s.n = n;
    s.slot = malloc(sizeof *s.slot * (size_t)(n + 1));
    int lacks = !s.slot || !hand_in(begin, row, value), any;
    MPI_Allreduce(&lacks, &any, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
    if (any) return fail(error, -13);
    s.m.n = n;
    int64_t code = job(ANALYSE);
    for (int room = 0; code >= 0 && room < 4; room++) { /* MUMPS may underestimate the memory that it needs */
        s.m.ICNTL(14) = MORE_ROOM_PERCENT << room;
        code = job(FACTORISE);
        if (code != -9 && code != -8) break;
        if (room < 3) code = 0;
    }
    take_back();
    if (code < 0 || s.m.INFOG(12) > 0) return fail(error, code < 0 ? code : 0);
    const int64_t entries = s.m.INFO(9);
    *bytes = 8 * (entries < 0 ? -entries * 1000000 : entries);
    return TM_OK;
}

/* --- solutions --- */

static bool solve_one(void *user, double *x) {
    (void)user;
    s.m.ICNTL(20) = 0;
    s.m.ICNTL(21) = 0;
    s.m.nrhs = 1;
    s.m.lrhs = s.n;
    s.m.rhs = x;
    return job(SOLVE) >= 0;
}

/* States unit right-hand sides on rank 0. Columns that were not requested get a unit vector too; their solution is
 * discarded. */
static bool state_units(const int32_t *unit, int32_t count) {
    s.m.nrhs = count;
    s.m.nz_rhs = count;
    if (s.rank) return true;
    s.m.irhs_ptr = malloc(sizeof *s.m.irhs_ptr * (size_t)(count + 1));
    s.m.irhs_sparse = malloc(sizeof *s.m.irhs_sparse * (size_t)count);
    s.m.rhs_sparse = malloc(sizeof *s.m.rhs_sparse * (size_t)count);
    if (!s.m.irhs_ptr || !s.m.irhs_sparse || !s.m.rhs_sparse) return false;
    for (int32_t j = 0; j <= count; j++) s.m.irhs_ptr[j] = j + 1;
    for (int32_t j = 0; j < count; j++) s.m.irhs_sparse[j] = unit[j] < 0 ? 1 : unit[j] + 1, s.m.rhs_sparse[j] = 1;
    return true;
}

/* Rows of the distributed solution: each rank sends the others which requested rows it has. */
typedef struct rows {
    int32_t *slot, *at; /* mine: index among the requested rows, and in this rank's part */
    int mine, all;
    int *count, *from; /* [ranks] */
    int32_t *of;       /* [all] indices of requested rows, rank by rank */
} rows;

static bool find_rows(const int32_t *row, int32_t row_count, rows *r) {
    for (int32_t i = 0; i < s.n; i++) s.slot[i] = -1;
    for (int32_t i = 0; i < row_count; i++) s.slot[row[i]] = i;
    *r = (rows){.slot = malloc(sizeof(int32_t) * (size_t)(s.m.lsol_loc + 1)),
                .at = malloc(sizeof(int32_t) * (size_t)(s.m.lsol_loc + 1)),
                .count = malloc(sizeof(int) * (size_t)s.ranks),
                .from = malloc(sizeof(int) * (size_t)s.ranks),
                .of = malloc(sizeof(int32_t) * (size_t)(row_count + 1))};
    if (!r->slot || !r->at || !r->count || !r->from || !r->of) return false;
    for (int32_t i = 0; i < s.m.INFO(23); i++) {
        const int32_t slot = s.slot[s.m.isol_loc[i] - 1];
        if (slot >= 0) r->slot[r->mine] = slot, r->at[r->mine++] = i;
    }
    MPI_Allgather(&r->mine, 1, MPI_INT, r->count, 1, MPI_INT, MPI_COMM_WORLD);
    for (int k = 0; k < s.ranks; k++) r->from[k] = r->all, r->all += r->count[k];
    if (r->all != row_count) return false;
    MPI_Allgatherv(r->slot, r->mine, MPI_INT32_T, r->of, r->count, r->from, MPI_INT32_T, MPI_COMM_WORLD);
    return true;
}

static void free_rows(rows *r) {
    free(r->slot);
    free(r->at);
    free(r->count);
    free(r->from);
    free(r->of);
}

/* Sends, column by column, each rank's rows to the rank that requested the column. */
static bool exchange(const rows *r, int32_t width, double *x) {
    double *out = malloc(8 * ((size_t)s.ranks * (size_t)r->mine + 1)), *in = malloc(8 * ((size_t)r->all + 1));
    int *send = malloc(sizeof *send * (size_t)s.ranks), *to = malloc(sizeof *to * (size_t)s.ranks);
    bool good = out && in && send && to;
    for (int k = 0; good && k < s.ranks; k++) send[k] = r->mine, to[k] = k * r->mine;
    for (int32_t j = 0; good && j < width; j++) {
        for (int k = 0; k < s.ranks; k++)
            for (int32_t i = 0; i < r->mine; i++)
                out[(size_t)k * (size_t)r->mine + (size_t)i] =
                    s.m.sol_loc[(size_t)(k * width + j) * (size_t)s.m.lsol_loc + (size_t)r->at[i]];
        good =
            MPI_Alltoallv(out, send, to, MPI_DOUBLE, in, r->count, r->from, MPI_DOUBLE, MPI_COMM_WORLD) == MPI_SUCCESS;
        for (int32_t i = 0; good && i < r->all; i++) x[(size_t)j * (size_t)r->all + (size_t)r->of[i]] = in[i];
    }
    free(out);
    free(in);
    free(send);
    free(to);
    return good;
}

static bool solve(void *user, const int32_t *unit, int32_t width, const int32_t *row, int32_t row_count, double *x) {
    (void)user;
    rows r = {0};
    s.m.ICNTL(20) = 3; /* sparse right-hand sides, with their sparsity used */
    s.m.ICNTL(21) = 1; /* the solution stays distributed */
    s.m.lsol_loc = s.m.INFO(23) > 0 ? s.m.INFO(23) : 1;
    s.m.sol_loc = malloc(8 * (size_t)s.m.lsol_loc * (size_t)width * (size_t)s.ranks);
    s.m.isol_loc = malloc(sizeof *s.m.isol_loc * (size_t)s.m.lsol_loc);
    int lacks = !state_units(unit, width * s.ranks) || !s.m.sol_loc || !s.m.isol_loc, any;
    MPI_Allreduce(&lacks, &any, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
    const bool good = !any && job(SOLVE) >= 0 && find_rows(row, row_count, &r) && exchange(&r, width, x);
    free_rows(&r);
    free(s.m.irhs_ptr);
    free(s.m.irhs_sparse);
    free(s.m.rhs_sparse);
    free(s.m.sol_loc);
    free(s.m.isol_loc);
    s.m.irhs_ptr = s.m.irhs_sparse = NULL;
    s.m.rhs_sparse = s.m.sol_loc = NULL;
    s.m.isol_loc = NULL;
    return good;
}

/* --- begin and end --- */

const tm_solve_distributed *shared_begin(int32_t threads, void **user) {
    static const tm_solve_distributed shared = {.factor = factor, .solve_one = solve_one, .solve = solve};
    MPI_Comm_rank(MPI_COMM_WORLD, &s.rank);
    MPI_Comm_size(MPI_COMM_WORLD, &s.ranks);
    s.m.par = 1;
    s.m.sym = 1;
    s.m.comm_fortran = (MUMPS_INT)MPI_Comm_c2f(MPI_COMM_WORLD);
    if (job(BEGIN) < 0) return NULL;
    s.begun = true;
    for (int i = 1; i <= 4; i++) s.m.ICNTL(i) = i < 4 ? -1 : 0; /* no output */
    s.m.ICNTL(16) = threads > 0 ? threads : 1;
    s.m.ICNTL(18) = 3; /* each rank passes its share */
    *user = NULL;
    return &shared;
}

void shared_end(void) {
    free(s.slot);
    s.slot = NULL;
    if (s.begun) job(END);
    s.begun = false;
}
