/* Many right-hand sides over threads and ranks, in blocks of fixed width: block b belongs to rank b mod count, whoever
 * solves it. */
#include "internal.h"

#include <pthread.h>
#include <string.h>

typedef struct worker {
    const tms_columns *c;
    tms_work *work;
    double *full_u, *full_f; /* [3*vertex_count], for interface columns */
    void *out;               /* of the block under way */
    int32_t block;           /* -1: nothing this round */
    bool failed;
} worker;

int32_t tms_columns_blocks(const tms_columns *c) {
    return (c->kept_count + c->interface_count + TMS_BLOCK - 1) / TMS_BLOCK;
}

static int32_t block_columns(const tms_columns *c, int32_t block) {
    const int32_t left = c->kept_count + c->interface_count - block * TMS_BLOCK;
    return left < TMS_BLOCK ? left : TMS_BLOCK;
}
static size_t entry_bytes(const tms_columns *c) { return c->precision == TM_DOUBLE ? 8 : 4; }
size_t tms_columns_block_bytes(const tms_columns *c, int32_t block) {
    return (size_t)block_columns(c, block) * (size_t)c->kept_count * entry_bytes(c);
}
static void *block_place(const tms_columns *c, int32_t block) {
    return (char *)c->out + (size_t)block * TMS_BLOCK * (size_t)c->kept_count * entry_bytes(c);
}

/* Right-hand side of column j: a unit force, or minus the coupling to a unit displacement of the interface. */
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
        for (int32_t i = 0; i < c->kept_count; i++) {
            const double value = xj[c->system->index[c->kept[i]]];
            if (c->precision == TM_DOUBLE)
                ((double *)w->out)[at + i] = value;
            else
                ((float *)w->out)[at + i] = (float)value;
        }
        const int32_t column = w->block * TMS_BLOCK + j - c->kept_count;
        if (column >= 0 && c->schur) schur_column(w, column, xj);
    }
    return NULL;
}

/* One block for each thread of this rank; then rank 0 collects what the other ranks solved in the same round. */
static tm_status run_round(worker *workers, int32_t threads, const tms_columns *c, const tm_solve_team *team,
                           int32_t first, tm_error *error) {
    const int32_t rank = team ? team->rank : 0, ranks = team ? team->count : 1, blocks = tms_columns_blocks(c);
    pthread_t thread[threads];
    bool started[threads];
    for (int32_t i = 0; i < threads; i++) {
        workers[i].block = first + i * ranks + rank < blocks ? first + i * ranks + rank : -1;
        if (rank == 0 && workers[i].block >= 0) workers[i].out = block_place(c, workers[i].block);
        started[i] = i > 0 && workers[i].block >= 0 && pthread_create(&thread[i], NULL, solve_block, &workers[i]) == 0;
    }
    for (int32_t i = 0; i < threads; i++)
        if (!started[i]) solve_block(&workers[i]);
    bool failed = workers[0].failed;
    for (int32_t i = 1; i < threads; i++) {
        if (started[i]) pthread_join(thread[i], NULL);
        failed |= workers[i].failed;
    }
    if (failed)
        return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                       "a column did not reach its tolerance; raise cg_max_iterations, or use the Cholesky solver");
    for (int32_t i = 0; rank > 0 && i < threads; i++)
        if (workers[i].block >= 0 &&
            !team->send(team->user, workers[i].block, workers[i].out, tms_columns_block_bytes(c, workers[i].block)))
            return tm_fail(error, TM_ERR_FILE, -1, "rank %d could not send its columns", (int)rank);
    for (int32_t i = 0; rank == 0 && i < threads; i++)
        for (int32_t r = 1; r < ranks; r++) {
            const int32_t block = first + i * ranks + r;
            if (block < blocks &&
                !team->receive(team->user, r, block, block_place(c, block), tms_columns_block_bytes(c, block)))
                return tm_fail(error, TM_ERR_FILE, -1, "rank %d did not deliver its columns", (int)r);
        }
    return TM_OK;
}

static bool take(worker *w, const tms_columns *c, int32_t rank) {
    const size_t n = 3 * (size_t)tm_tissue_mesh(c->tissue)->vertex_count;
    w->c = c;
    w->work = tms_work_create(c->solver, TMS_BLOCK);
    w->full_u = tms_take_zeroed(n, 8);
    w->full_f = tms_take(n * 8);
    if (rank > 0) w->out = tms_take((size_t)TMS_BLOCK * (size_t)c->kept_count * entry_bytes(c));
    return w->work && w->full_u && w->full_f && (rank == 0 || w->out);
}

tm_status tms_columns_run(const tms_columns *c, const tm_solve_def *def, const tm_solve_team *team, tm_error *error) {
    const int32_t rank = team ? team->rank : 0, ranks = team ? team->count : 1, threads = tms_threads(def),
                  blocks = tms_columns_blocks(c);
    worker *workers = tms_take_zeroed((size_t)threads, sizeof *workers);
    tm_status status = workers ? TM_OK : TM_ERR_MEMORY;
    for (int32_t i = 0; status == TM_OK && i < threads; i++)
        if (!take(&workers[i], c, rank)) status = TM_ERR_MEMORY;
    if (status == TM_ERR_MEMORY)
        tm_fail(error, status, -1, "no memory to solve %d columns at a time in %d threads; use fewer threads",
                TMS_BLOCK, (int)threads);
    const double start = tms_clock_s();
    tms_process_enter(); /* all of the time: to go in and out with each block would be to switch with each */
    for (int32_t first = 0; status == TM_OK && first < blocks; first += threads * ranks) {
        const double done = (double)first / blocks;
        if (!tms_progress(def, "responses", done, first ? (tms_clock_s() - start) * (1 - done) / done : -1))
            status = tm_fail(error, TM_ERR_CONVERGENCE, -1, "stopped by the caller");
        else
            status = run_round(workers, threads, c, team, first, error);
    }
    tms_process_leave();
    if (status == TM_OK) tms_progress(def, "responses", 1, 0);
    for (int32_t i = 0; workers && i < threads; i++) {
        tms_work_destroy(workers[i].work);
        tms_give(workers[i].full_u);
        tms_give(workers[i].full_f);
        if (rank > 0) tms_give(workers[i].out);
    }
    tms_give(workers);
    return status;
}
