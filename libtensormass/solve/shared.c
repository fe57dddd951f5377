/* Columns by one factor that the ranks share: all of them solve together, as many blocks at a time as there are ranks,
 * and each writes one. */
#include "internal.h"

/* Units of one round: rank r's in unit[r * TMS_BLOCK ..]. */
static void ask(const tms_columns *c, const int32_t *todo, int32_t count, int32_t ranks, int32_t *unit) {
    for (int32_t r = 0; r < ranks; r++)
        for (int32_t j = 0; j < TMS_BLOCK; j++) {
            const int32_t column = r < count ? todo[r] * TMS_BLOCK + j : c->kept_count;
            unit[r * TMS_BLOCK + j] = column < c->kept_count ? c->system->index[c->kept[column]] : -1;
        }
}

/* This rank's block of the round, as it was solved. */
static bool deliver(const tms_columns *c, int32_t rank, int32_t block, const double *x, void *own) {
    void *out = rank == 0 ? tms_columns_place(c, block) : own;
    for (int32_t j = 0; j < TMS_BLOCK && block * TMS_BLOCK + j < c->kept_count; j++)
        for (int32_t i = 0; i < c->kept_count; i++) {
            const int64_t at = (int64_t)j * c->kept_count + i;
            tms_columns_store(c, out, at, x[at]);
        }
    return tms_columns_put(c, block, out);
}

tm_status tms_shared_columns(const tms_columns *c, const tm_solve_def *def, const tm_solve_team *team,
                             tm_error *error) {
    const size_t entries = (size_t)TMS_BLOCK * (size_t)c->kept_count;
    int32_t count, *todo = tms_columns_todo(c, &count),
                   *unit = tms_take(sizeof *unit * TMS_BLOCK * (size_t)team->count),
                   *row = tms_take(sizeof *row * (size_t)(c->kept_count + 1));
    double *x = tms_take(8 * (entries + 1));
    void *own = tms_take(8 * (entries + 1));
    tm_status status = todo && unit && row && x && own ? TM_OK : TM_ERR_MEMORY;
    if (status != TM_OK)
        tm_fail(error, status, -1, "no memory to solve %d columns at a time; use a coarser mesh", TMS_BLOCK);
    for (int32_t i = 0; status == TM_OK && i < c->kept_count; i++) row[i] = c->system->index[c->kept[i]];
    if (status == TM_OK) status = tms_team_meet(team, error);
    const double start = tms_clock_s();
    for (int32_t first = 0; status == TM_OK && first < count; first += team->count) {
        const int32_t mine = first + team->rank;
        status = tms_columns_told(def, first, count, start, error);
        if (status != TM_OK) break;
        ask(c, todo + first, count - first, team->count, unit);
        if (!team->shared->solve(team->user, unit, TMS_BLOCK, row, c->kept_count, x))
            status = tm_fail(error, TM_ERR_CONVERGENCE, -1, "the shared factor did not solve a block of columns");
        else if (mine < count && !deliver(c, team->rank, todo[mine], x, own))
            status = tm_fail(error, TM_ERR_FILE, -1, "rank %d could not write its columns; is the disk full?",
                             (int)team->rank);
    }
    if (status == TM_OK) status = tms_columns_meet(c, team, error);
    if (status == TM_OK) tms_progress(def, "responses", 1, 0);
    tms_give(todo);
    tms_give(unit);
    tms_give(row);
    tms_give(x);
    tms_give(own);
    return status;
}
