/* The corrections of the listed batches, divided among the world's threads by their index in the list, since their work
 * lies where tissue has rotated: the partitions of vertices, which balance the force, may have all of it in one. Each
 * part adds to the vertices that no earlier part reaches. The other forces of its batches are stored, and added when
 * all are done, part after part. So each vertex sums in the list's order, for any number of threads, and no batch is
 * computed twice. */
#include "world/divided_batches.h"

#include <string.h>

enum {
    WORTH = 64, /* fewer batches do not repay the synchronisation */
    WHOLE = 8   /* parts: of fewer, so many eighths of the batches may be stored; more would not repay the sums */
};

static int32_t begin_of(const tm_divided_batches *d, int32_t part) {
    return tm_tet_batches_before(d->rotation->list_count, part, d->world->partition_count);
}

/* --- division: once for each list --- */

/* Takes the batch's vertices that have no owner. Returns whether an earlier part owns one. */
static bool take_vertices(const tm_divided_batches *d, int32_t batch, uint8_t part) {
    const tm_tet_span span = d->rotation->batches.span[batch];
    const int32_t *vertex = d->rotation->batches.mesh->tet;
    bool earlier = false;
    for (int64_t i = 4 * (int64_t)span.tet; i < 4 * (int64_t)tm_tet_span_end(span); i++) {
        uint8_t *owner = d->owner + vertex[i];
        if (*owner > part) *owner = part;
        earlier |= *owner < part;
    }
    return earlier;
}

static void divide(tm_divided_batches *d) {
    const tm_rotation *r = d->rotation;
    int32_t late = 0;
    d->listing = r->listing;
    d->pays = r->list_count >= WORTH;
    if (!d->pays) return;
    memset(d->owner, TM_MAX_THREADS, (size_t)r->batches.mesh->vertex_count);
    for (int32_t part = 0; part < d->world->partition_count; part++) {
        d->late_begin[part] = late;
        for (int32_t n = begin_of(d, part); n < begin_of(d, part + 1); n++) {
            if (!take_vertices(d, r->list[n], (uint8_t)part)) continue;
            if (late < d->capacity) d->late[late] = n;
            late++;
        }
    }
    d->late_begin[d->world->partition_count] = late;
    d->pays = late <= d->capacity;
}

/* --- computation --- */

/* Adds the corner forces of a batch that straddles to those vertices that the part owns, or to the others. */
static void add_corners(const tm_divided_batches *d, int32_t late, int32_t part, bool owned) {
    const tm_rotation *r = d->rotation;
    const tm_tet_batch *batch = r->batches.batch + r->list[d->late[late]];
    double *TM_RESTRICT force_N = r->conserving.now_N;
    for (int l = 0; l < TM_LANES; l++) {
        if (!(d->who[late] >> l & 1)) continue;
        const double *f = d->corner_N + 12 * TM_LANES * (int64_t)late + l;
        for (int k = 0; k < 4; k++, f += 3 * TM_LANES) {
            const int32_t c = batch->component[k][l];
            if ((d->owner[c / 3] == part) != owned) continue;
            for (int i = 0; i < 3; i++) force_N[c + i] -= f[TM_LANES * i];
        }
    }
}

static void run_part(void *context, int32_t part) {
    const tm_divided_batches *d = context;
    tm_rotation *r = d->rotation;
    const double *u_m = d->world->state.u_m;
    const int32_t end = begin_of(d, part + 1);
    int32_t late = d->late_begin[part], active = 0;
    for (int32_t n = begin_of(d, part), next; n < end; n = next + 1) {
        next = late < d->late_begin[part + 1] ? d->late[late] : end;
        active += r->kernel(&r->batches, r->list + n, next - n, u_m, r->conserving.now_N, r->conserving.batch_J + n);
        if (next == end) break;
        d->corner_force(&r->batches, r->list + next, 1, u_m, d->corner_N + 12 * TM_LANES * (int64_t)late, d->who + late,
                        r->conserving.batch_J + next);
        add_corners(d, late, part, true);
        active += d->who[late++] != 0;
    }
    d->active[part] = active;
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
    tm_partitions_run(d->world, run_part, d);
    r->active = d->active[0];
    for (int32_t part = 1; part < parts; part++) {
        for (int32_t late = d->late_begin[part]; late < d->late_begin[part + 1]; late++)
            add_corners(d, late, part, false);
        r->active += d->active[part];
    }
}

bool tm_divided_batches_init(tm_divided_batches *d, tm_pool *pool, tm_world *world, tm_rotation *rotation) {
    const int32_t parts = world->partition_count, count = rotation->batches.count;
    *d = (tm_divided_batches){.rotation = rotation, .world = world, .listing = -1};
    if (parts == 1) return true;
    d->corner_force = tm_corner_force_choose(world->tissue->plain);
    d->capacity = parts < WHOLE ? (int32_t)((int64_t)count * parts / WHOLE) : count;
    d->owner = TM_ALLOC(pool, uint8_t, rotation->batches.mesh->vertex_count);
    d->active = TM_ALLOC(pool, int32_t, parts);
    d->late_begin = TM_ALLOC(pool, int32_t, parts + 1);
    d->late = TM_ALLOC(pool, int32_t, d->capacity);
    d->corner_N = TM_ALLOC(pool, double, 12 * TM_LANES * (int64_t)d->capacity);
    d->who = TM_ALLOC(pool, uint8_t, d->capacity);
    return !pool->failed;
}
