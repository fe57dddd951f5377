/* Solves many right-hand sides with threads and ranks, in blocks of fixed width, so that results do not depend on their
 * number. */
#include "internal.h"

#include <pthread.h>
#include <string.h>

typedef struct worker {
    const tms_columns *c;
    tms_work *work;
    double *full_u, *full_f; /* [3*vertex_count], for interface columns */
    void *out;               /* of the present block */
    int32_t block;           /* -1: nothing in this round */
    bool failed, lost;       /* not solved; not written */
} worker;

static int32_t count_blocks(const tms_columns *c) {
    return (c->kept_count + c->interface_count + TMS_BLOCK - 1) / TMS_BLOCK;
}
static int32_t block_columns(const tms_columns *c, int32_t block) {
    const int32_t left = c->kept_count + c->interface_count - block * TMS_BLOCK;
    return left < TMS_BLOCK ? left : TMS_BLOCK;
}
static size_t entry_bytes(const tms_columns *c) { return c->precision == TM_DOUBLE ? 8 : 4; }

/* Returns the place of a block on rank 0. */
static void *tms_columns_place(const tms_columns *c, int32_t block) {
    return (char *)c->out + (size_t)block * TMS_BLOCK * (size_t)c->kept_count * entry_bytes(c);
}

/* Rounds x to the precision of the columns. */
static void tms_columns_store(const tms_columns *c, void *out, int64_t at, double x) {
    if (c->precision == TM_DOUBLE)
        ((double *)out)[at] = x;
    else
        ((float *)out)[at] = (float)x;
}

/* Records a solved block; on ranks above 0 writes it. */
static bool tms_columns_put(const tms_columns *c, int32_t block, const void *data) {
    return !c->partial_file ||
           tms_partial_file_put(c->partial_file, block, data,
                                (size_t)block_columns(c, block) * (size_t)c->kept_count * entry_bytes(c));
}

/* Lists the blocks still to be solved, ascending; returns null if memory is exhausted. */
static int32_t *tms_columns_todo(const tms_columns *c, int32_t *count) {
    const int32_t blocks = count_blocks(c);
    int32_t *todo = tms_alloc(sizeof *todo * (size_t)(blocks + 1));
    *count = 0;
    for (int32_t b = 0; todo && b < blocks; b++)
        if (!c->partial_file || !c->partial_file->done[b]) todo[(*count)++] = b;
    return todo;
}

tm_status tms_ranks_barrier(const tm_solve_ranks *rank_group, tm_error *error) {
    return !rank_group || rank_group->barrier(rank_group->user)
               ? TM_OK
               : tm_fail(error, TM_ERR_FILE, -1, "a rank of this run has ended; start all ranks again");
}

/* Reports the progress before block `first` of `count`, begun at `start_s`; fails if the caller requests a stop. */
static tm_status tms_columns_told(const tm_solve_def *def, int32_t first, int32_t count, double start_s,
                                  tm_error *error) {
    const double done = (double)first / count, left_s = first ? (tms_clock_s() - start_s) * (1 - done) / done : -1;
    return tms_progress(def, "responses", done, left_s)
               ? TM_OK
               : tm_fail(error, TM_ERR_CONVERGENCE, -1, "stopped by the caller");
}

/* Waits for the other ranks; rank 0 then checks that all blocks are done. */
static tm_status tms_columns_barrier(const tms_columns *c, const tm_solve_ranks *rank_group, tm_error *error) {
    const tm_status status = tms_ranks_barrier(rank_group, error);
    if (status != TM_OK) return status;
    for (int32_t b = 0; c->partial_file && (!rank_group || rank_group->rank == 0) && b < c->partial_file->block_count;
         b++)
        if (!c->partial_file->done[b])
            return tm_fail(
                error, TM_ERR_FILE, -1,
                "block %d of the columns was not written by its rank; put the file into a folder that all ranks share",
                (int)b);
    return TM_OK;
}

/* Sets the right-hand side of column j: a unit force, or minus the coupling to a unit displacement of the interface. */
static void fill_rhs(worker *w, int32_t j, double *b) {
    const tms_columns *c = w->c;
    const tms_system *s = c->system;
    memset(b, 0, (size_t)s->n * 8);
    if (j < c->kept_count) {
        b[s->index[c->kept[j]]] = 1;
    } else if (j < c->kept_count + c->interface_count) {
        const int32_t dof = c->interface[j - c->kept_count];
        w->full_u[dof] = 1;
        tm_tissue_force(c->tissue, w->full_u, w->full_f);
        w->full_u[dof] = 0;
        for (int32_t i = 0; i < s->n; i++) b[i] = w->full_f[s->dof[i]];
    }
}

static void schur_column(worker *w, int32_t column, const double *x) {
    const tms_columns *c = w->c;
    for (int32_t i = 0; i < c->system->n; i++) w->full_u[c->system->dof[i]] = x[i];
    w->full_u[c->interface[column]] = 1;
    tm_tissue_force(c->tissue, w->full_u, w->full_f);
    for (int32_t i = 0; i < c->interface_count; i++)
        c->schur[(int64_t)column * c->interface_count + i] = -w->full_f[c->interface[i]];
    for (int32_t i = 0; i < c->system->n; i++) w->full_u[c->system->dof[i]] = 0;
    w->full_u[c->interface[column]] = 0;
}

static void *solve_block(void *argument) {
    worker *w = argument;
    const tms_columns *c = w->c;
    const int32_t n = c->system->n;
    if (w->block < 0) return NULL;
    double *b = tms_work_rhs(w->work);
    for (int32_t j = 0; j < TMS_BLOCK; j++) fill_rhs(w, w->block * TMS_BLOCK + j, b + (int64_t)j * n);
    const double *x = tms_work_solve(w->work);
    if (!x) {
        w->failed = true;
        return NULL;
    }
    for (int32_t j = 0; j < block_columns(c, w->block); j++) {
        const double *xj = x + (int64_t)j * n;
        const int64_t at = (int64_t)j * c->kept_count;
        for (int32_t i = 0; i < c->kept_count; i++)
            tms_columns_store(c, w->out, at + i, xj[c->system->index[c->kept[i]]]);
        const int32_t column = w->block * TMS_BLOCK + j - c->kept_count;
        if (column >= 0 && c->schur) schur_column(w, column, xj);
    }
    w->lost = !tms_columns_put(c, w->block, w->out);
    return NULL;
}

/* Solves one block per thread of this rank. */
static tm_status run_round(worker *workers, int32_t threads, const tms_columns *c, const tm_solve_ranks *rank_group,
                           const int32_t *todo, int32_t count, tm_error *error) {
    const int32_t rank = rank_group ? rank_group->rank : 0, ranks = rank_group ? rank_group->count : 1;
    pthread_t thread[threads];
    bool started[threads];
    for (int32_t i = 0; i < threads; i++) {
        workers[i].block = i * ranks + rank < count ? todo[i * ranks + rank] : -1;
        if (rank == 0 && workers[i].block >= 0) workers[i].out = tms_columns_place(c, workers[i].block);
        started[i] = i > 0 && workers[i].block >= 0 && pthread_create(&thread[i], NULL, solve_block, &workers[i]) == 0;
    }
    for (int32_t i = 0; i < threads; i++)
        if (!started[i]) solve_block(&workers[i]);
    bool failed = workers[0].failed, lost = workers[0].lost;
    for (int32_t i = 1; i < threads; i++) {
        if (started[i]) pthread_join(thread[i], NULL);
        failed |= workers[i].failed;
        lost |= workers[i].lost;
    }
    if (failed)
        return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                       "a column did not reach the tolerance; raise cg_max_iterations, or use the Cholesky solver");
    if (lost)
        return tm_fail(error, TM_ERR_FILE, -1, "rank %d could not write its columns; check the disk, which may be full",
                       (int)rank);
    return TM_OK;
}

static bool take(worker *w, const tms_columns *c, int32_t rank) {
    const size_t n = 3 * (size_t)tm_tissue_mesh(c->tissue)->vertex_count;
    w->c = c;
    w->work = tms_work_create(c->solver, TMS_BLOCK);
    w->full_u = tms_alloc_zeroed(n, 8);
    w->full_f = tms_alloc(n * 8);
    if (rank > 0) w->out = tms_alloc((size_t)TMS_BLOCK * (size_t)c->kept_count * entry_bytes(c));
    return w->work && w->full_u && w->full_f && (rank == 0 || w->out);
}

static tm_status take_all(const tms_columns *c, int32_t rank, int32_t threads, worker **workers, tm_error *error) {
    worker *all = tms_alloc_zeroed((size_t)threads, sizeof *all);
    bool taken = all != NULL;
    for (int32_t i = 0; taken && i < threads; i++) taken = take(&all[i], c, rank);
    *workers = all;
    if (taken) return TM_OK;
    return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to solve %d columns at a time in %d threads; use fewer threads",
                   TMS_BLOCK, (int)threads);
}

static void give_all(worker *workers, int32_t rank, int32_t threads) {
    for (int32_t i = 0; workers && i < threads; i++) {
        tms_work_destroy(workers[i].work);
        tms_free(workers[i].full_u);
        tms_free(workers[i].full_f);
        if (rank > 0) tms_free(workers[i].out);
    }
    tms_free(workers);
}

tm_status tms_columns_run(const tms_columns *c, const tm_solve_def *def, const tm_solve_ranks *rank_group,
                          tm_error *error) {
    const int32_t rank = rank_group ? rank_group->rank : 0, ranks = rank_group ? rank_group->count : 1,
                  threads = tms_threads(def), step = threads * ranks;
    worker *workers = NULL;
    int32_t count, *todo = tms_columns_todo(c, &count);
    tm_status status = todo ? take_all(c, rank, threads, &workers, error)
                            : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a list of blocks; use a coarser mesh");
    /* No rank may write before all have read which blocks are done. */
    if (status == TM_OK) status = tms_ranks_barrier(rank_group, error);
    const double start = tms_clock_s();
    tms_process_enter(); /* for the complete run: entering per block would change the settings each time */
    for (int32_t first = 0; status == TM_OK && first < count; first += step) {
        status = tms_columns_told(def, first, count, start, error);
        if (status == TM_OK) status = run_round(workers, threads, c, rank_group, todo + first, count - first, error);
    }
    tms_process_leave();
    if (status == TM_OK) status = tms_columns_barrier(c, rank_group, error);
    if (status == TM_OK) tms_progress(def, "responses", 1, 0);
    give_all(workers, rank, threads);
    tms_free(todo);
    return status;
}

/* Computes columns with one factor distributed over the ranks. All ranks solve together, as many blocks at a time as
 * there are ranks, and each writes one. */

/* Lists the unit forces of one round: rank r's in unit[r * TMS_BLOCK ..]. */
static void ask(const tms_columns *c, const int32_t *todo, int32_t count, int32_t ranks, int32_t *unit) {
    for (int32_t r = 0; r < ranks; r++)
        for (int32_t j = 0; j < TMS_BLOCK; j++) {
            const int32_t column = r < count ? todo[r] * TMS_BLOCK + j : c->kept_count;
            unit[r * TMS_BLOCK + j] = column < c->kept_count ? c->system->index[c->kept[column]] : -1;
        }
}

/* Stores this rank's solved block of the round. */
static bool deliver(const tms_columns *c, int32_t rank, int32_t block, const double *x, void *own) {
    void *out = rank == 0 ? tms_columns_place(c, block) : own;
    for (int32_t j = 0; j < TMS_BLOCK && block * TMS_BLOCK + j < c->kept_count; j++)
        for (int32_t i = 0; i < c->kept_count; i++) {
            const int64_t at = (int64_t)j * c->kept_count + i;
            tms_columns_store(c, out, at, x[at]);
        }
    return tms_columns_put(c, block, out);
}

tm_status tms_distributed_columns(const tms_columns *c, const tm_solve_def *def, const tm_solve_ranks *rank_group,
                                  tm_error *error) {
    const size_t entries = (size_t)TMS_BLOCK * (size_t)c->kept_count;
    int32_t count, *todo = tms_columns_todo(c, &count),
                   *unit = tms_alloc(sizeof *unit * TMS_BLOCK * (size_t)rank_group->count),
                   *row = tms_alloc(sizeof *row * (size_t)(c->kept_count + 1));
    double *x = tms_alloc(8 * (entries + 1));
    void *own = tms_alloc(8 * (entries + 1));
    tm_status status = todo && unit && row && x && own ? TM_OK : TM_ERR_MEMORY;
    if (status != TM_OK)
        tm_fail(error, status, -1, "no memory to solve %d columns at a time; use a coarser mesh", TMS_BLOCK);
    for (int32_t i = 0; status == TM_OK && i < c->kept_count; i++) row[i] = c->system->index[c->kept[i]];
    if (status == TM_OK) status = tms_ranks_barrier(rank_group, error);
    const double start = tms_clock_s();
    for (int32_t first = 0; status == TM_OK && first < count; first += rank_group->count) {
        const int32_t mine = first + rank_group->rank;
        status = tms_columns_told(def, first, count, start, error);
        if (status != TM_OK) break;
        ask(c, todo + first, count - first, rank_group->count, unit);
        if (!rank_group->distributed->solve(rank_group->user, unit, TMS_BLOCK, row, c->kept_count, x))
            status = tm_fail(
                error, TM_ERR_CONVERGENCE, -1,
                "the distributed factor did not solve a block of columns; start the run again, or use --factor each");
        else if (mine < count && !deliver(c, rank_group->rank, todo[mine], x, own))
            status = tm_fail(error, TM_ERR_FILE, -1,
                             "rank %d could not write its columns; check the disk, which may be full",
                             (int)rank_group->rank);
    }
    if (status == TM_OK) status = tms_columns_barrier(c, rank_group, error);
    if (status == TM_OK) tms_progress(def, "responses", 1, 0);
    tms_free(todo);
    tms_free(unit);
    tms_free(row);
    tms_free(x);
    tms_free(own);
    return status;
}
