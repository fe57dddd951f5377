/* The corrections of the listed batches, divided among the world's threads by their index in the list, since their work
 * lies where tissue has rotated: the partitions of vertices, which balance the force, may have all of it in one. Each
 * part owns the vertices that no batch before its first one has, listed or not, and adds to these. The other forces of
 * its batches are stored, and added when all are done, part after part, by the thread that has the vertex then. So each
 * vertex sums in the list's order, for any number of threads, and no batch is computed twice. Shares of the list follow
 * the measured times of the threads, which have work of other stages too (overlaps.c). */
#include "world/divided_batches.h"

enum {
    WORTH = 64, /* fewer batches do not repay the synchronisation */
    WHOLE = 8   /* parts: of fewer, so many eighths of the batches may be stored; more would not repay the sums */
};

static int32_t begin_of(const tm_divided_batches *d, int32_t part) {
    return (int32_t)(d->before[part] * d->rotation->list_count);
}

/* Returns the batch with which a part begins: the vertices of earlier ones are not its own. */
static int32_t first_of(const tm_divided_batches *d, int32_t part) {
    const int32_t begin = begin_of(d, part);
    return begin < d->rotation->list_count ? d->rotation->list[begin] : INT32_MAX;
}

/* --- division: once for each list, and when shares have moved --- */

/* Moves half of each thread's time above the mean to the others. */
static void balance(tm_divided_batches *d) {
    enum { EVERY = 4 };
    static const double GAIN = 0.5, ALIKE = 0.02;
    const int32_t parts = d->world->partition_count;
    double mean_s = 0, most_s = 0, sum = 0, share[TM_MAX_THREADS];
    if (++d->runs % EVERY) return;
    for (int32_t p = 0; p < parts; p++) {
        mean_s += d->took_s[p] / parts;
        most_s = d->took_s[p] > most_s ? d->took_s[p] : most_s;
    }
    for (int32_t p = 0; p < parts; p++) {
        const double own = d->before[p + 1] - d->before[p], moved = GAIN * (1 - d->took_s[p] / mean_s) / parts;
        share[p] = own + moved > 0 ? own + moved : 0;
        sum += share[p];
        d->took_s[p] = 0;
    }
    if (!(most_s > (1 + ALIKE) * mean_s) || !(sum > 0)) return;
    for (int32_t p = 1; p < parts; p++) d->before[p] = d->before[p - 1] + share[p - 1] / sum;
    d->listing = -1;
}

static void divide(tm_divided_batches *d) {
    const tm_rotation *r = d->rotation;
    int32_t late = 0;
    d->listing = r->listing;
    d->pays = r->list_count >= WORTH;
    for (int32_t part = 0; d->pays && part < d->world->partition_count; part++) {
        const int32_t first = first_of(d, part), end = begin_of(d, part + 1);
        d->late_begin[part] = late;
        for (int32_t n = begin_of(d, part); n < end && part > 0; n++) {
            if (d->lowest[r->list[n]] >= first) continue;
            if (late < d->capacity) d->late[late] = n, d->late_batch[late] = r->list[n];
            late++;
        }
    }
    d->late_begin[d->world->partition_count] = late;
    d->pays = d->pays && late <= d->capacity;
}

/* --- computation --- */

/* Adds the corner forces of a batch that straddles to those of the vertices [begin, end) that its part owns, or to
 * those that it does not. first: the batch with which the part begins. */
static void add_corners(const tm_divided_batches *d, int32_t late, int32_t first, bool owned, int32_t begin,
                        int32_t end) {
    const tm_rotation *r = d->rotation;
    const tm_tet_batch *batch = r->batches.batch + d->late_batch[late];
    double *TM_RESTRICT force_N = r->conserving.now_N;
    for (int l = 0; l < TM_LANES; l++) {
        if (!(d->who[late] >> l & 1)) continue;
        const double *f = d->corner_N + 12 * TM_LANES * (int64_t)late + l;
        for (int k = 0; k < 4; k++, f += 3 * TM_LANES) {
            const int32_t c = batch->component[k][l];
            if (c < 3 * begin || c >= 3 * end || (d->first[c / 3] >= first) != owned) continue;
            for (int i = 0; i < 3; i++) force_N[c + i] -= f[TM_LANES * i];
        }
    }
}

static void run_part(void *context, int32_t part) {
    const tm_divided_batches *d = context;
    tm_rotation *r = d->rotation;
    const double since_s = tm_clock_s();
    if (d->overlaps) tm_overlaps_work(d->world, part);
    const double *u_m = d->world->state.u_m;
    const int32_t end = begin_of(d, part + 1), first = first_of(d, part);
    int32_t late = d->late_begin[part], active = 0;
    d->corner_force(&r->batches, d->late_batch + late, d->late_begin[part + 1] - late, u_m,
                    d->corner_N + 12 * TM_LANES * (int64_t)late, d->who + late, d->late_J + late);
    for (int32_t n = begin_of(d, part), next; n < end; n = next + 1) {
        next = late < d->late_begin[part + 1] ? d->late[late] : end;
        active += r->kernel(&r->batches, r->list + n, next - n, u_m, r->conserving.now_N, r->conserving.batch_J + n);
        if (next == end) break;
        r->conserving.batch_J[next] = d->late_J[late];
        add_corners(d, late, first, true, 0, r->batches.mesh->vertex_count);
        active += d->who[late++] != 0;
    }
    d->active[part] = active;
    d->took_s[part] += tm_clock_s() - since_s;
}

/* Adds what is left, to a part of the vertices. */
static void finish_part(void *context, int32_t part) {
    const tm_divided_batches *d = context;
    const int32_t n = d->rotation->batches.mesh->vertex_count, parts = d->world->partition_count,
                  begin = tm_tet_batches_before(n, part, parts), end = tm_tet_batches_before(n, part + 1, parts);
    for (int32_t of = 1; of < parts; of++)
        for (int32_t late = d->late_begin[of]; late < d->late_begin[of + 1]; late++)
            add_corners(d, late, first_of(d, of), false, begin, end);
}

void tm_divided_batches_run(tm_divided_batches *d) {
    tm_rotation *r = d->rotation;
    const int32_t parts = d->world->partition_count;
    if (parts > 1 && d->listing != r->listing) divide(d);
    r->divided = parts > 1 && d->pays;
    if (!r->divided) {
        r->active = r->kernel(&r->batches, r->list, r->list_count, d->world->state.u_m, r->conserving.now_N,
                              r->conserving.batch_J);
        return;
    }
    d->overlaps = !d->world->evaluating && !d->world->settling && tm_overlaps_begin_after(d->world, r);
    tm_partitions_run(d->world, run_part, d);
    tm_partitions_run(d->world, finish_part, d);
    balance(d);
    r->active = 0;
    for (int32_t part = 0; part < parts; part++) r->active += d->active[part];
}

/* Finds the first batch of each vertex, and the lowest of those of a batch's vertices. */
static void find_first(tm_divided_batches *d) {
    const tm_tet_batches *b = &d->rotation->batches;
    for (int32_t v = 0; v < b->mesh->vertex_count; v++) d->first[v] = INT32_MAX;
    for (int32_t p = 0; p < b->count; p++) {
        d->lowest[p] = p;
        for (int64_t i = 4 * (int64_t)b->span[p].tet; i < 4 * (int64_t)tm_tet_span_end(b->span[p]); i++) {
            int32_t *first = d->first + b->mesh->tet[i];
            if (*first > p) *first = p;
            if (*first < d->lowest[p]) d->lowest[p] = *first;
        }
    }
}

bool tm_divided_batches_init(tm_divided_batches *d, tm_pool *pool, tm_world *world, tm_rotation *rotation) {
    const int32_t parts = world->partition_count, count = rotation->batches.count;
    *d = (tm_divided_batches){.rotation = rotation, .world = world, .listing = -1};
    if (parts == 1) return true;
    d->corner_force = rotation->batches.single ? tm_single_corner_force_choose(world->tissue->plain)
                                               : tm_corner_force_choose(world->tissue->plain);
    d->capacity = parts < WHOLE ? (int32_t)((int64_t)count * parts / WHOLE) : count;
    d->first = TM_ALLOC(pool, int32_t, rotation->batches.mesh->vertex_count);
    d->lowest = TM_ALLOC(pool, int32_t, count);
    d->active = TM_ALLOC(pool, int32_t, parts);
    d->took_s = TM_ALLOC(pool, double, parts);
    d->before = TM_ALLOC(pool, double, parts + 1);
    d->late_begin = TM_ALLOC(pool, int32_t, parts + 1);
    d->late = TM_ALLOC(pool, int32_t, d->capacity);
    d->late_batch = TM_ALLOC(pool, int32_t, d->capacity);
    d->late_J = TM_ALLOC(pool, double, d->capacity);
    d->corner_N = TM_ALLOC(pool, double, 12 * TM_LANES * (int64_t)d->capacity);
    d->who = TM_ALLOC(pool, uint8_t, d->capacity);
    if (pool->failed) return false;
    for (int32_t p = 0; p <= parts; p++) d->before[p] = (double)p / parts;
    find_first(d);
    return true;
}
