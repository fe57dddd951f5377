/* Stage "cut": active cauteries remove tetrahedra on contact, at a limited rate. Detached fragments are searched for a
 * little each step. They are removed at once, or when they have fallen out of sight. */
#include "cut/cut_internal.h"
#include "tensormass/cut.h"

#include <math.h>
#include <string.h>

enum { TM_COOKIE_CUT = 0x63757421 };

enum {
    SWEEP_PER_STEP = 2048, /* tetrahedra checked per step for fragments after the flood */
    LOOSE_PER_STEP = 32,   /* fragment tetrahedra removed in a step */
    FALLING_PAUSE = 256    /* steps between two searches while fragments fall */
};
static const double OUTSIDE_REMOVAL_DISTANCE =
    3; /* fall distance of a fragment before removal, in diagonals of the mesh */

tm_cut_def tm_cut_def_default(void) {
    return (tm_cut_def){.cookie = TM_COOKIE_CUT, .size = sizeof(tm_cut_def), .rate_1_s = 200, .loose = TM_LOOSE_FALL};
}

static void remove_tet(tm_cut_stage *stage, tm_world *world, const int32_t *tet, int32_t count, int8_t instrument) {
    tm_tissue *tissue = world->tissue;
    if (tm_cut_remove(tissue, tet, count, NULL, 0) == 0) return;
    const int32_t *removed, removed_count = tm_cut_removed(tissue, &removed);
    if (stage->fading.fade_s > 0) tm_fading_begin(&stage->fading, removed, removed_count);
    for (int32_t i = 0; i < removed_count && stage->log_count < tissue->mesh->tet_count; i++) {
        const int32_t at = (stage->log_begin + stage->log_count++) % tissue->mesh->tet_count;
        stage->log_tet[at] = removed[i];
        stage->log_instrument[at] = instrument;
    }
    tm_world_cut(world);
}

/* --- cautery --- */

/* Returns the active tetrahedron behind the deepest loaded row, lowest face first among equals; -1 without contact. */
static int32_t deepest(const tm_cut_stage *stage, const tm_world *world, int32_t instrument) {
    const tm_contact_row *row, *best = NULL;
    const int32_t rows = tm_contact_rows(stage->contact, &row);
    for (int32_t i = 0; i < rows; i++) {
        if (row[i].instrument != instrument || !(row[i].lambda_N > 0) || !world->tissue->alive[row[i].face / 4] ||
            (stage->keep && stage->keep[row[i].face / 4]))
            continue;
        if (!best || row[i].gap_m < best->gap_m || (row[i].gap_m == best->gap_m && row[i].face < best->face))
            best = row + i;
    }
    return best ? best->face / 4 : -1;
}

static void cauterise(tm_cut_stage *stage, tm_world *world) {
    for (int32_t i = 0; i < stage->contact->tool_count; i++) {
        if (stage->contact->tool[i].def.mode != TM_TOOL_CAUTERY || !tm_contact_pose(stage->contact, i).active) continue;
        int32_t tet = deepest(stage, world, i);
        if (tet < 0) continue;
        stage->credit[i] += stage->rate_1_s * world->state.dt_s;
        for (; stage->credit[i] >= 1 && tet >= 0; tet = deepest(stage, world, i)) {
            stage->credit[i] -= 1;
            remove_tet(stage, world, &tet, 1, (int8_t)i);
        }
        stage->credit[i] = fmin(stage->credit[i], 1);
    }
}

/* --- removal of detached fragments (cut_search.c) --- */

static bool is_beyond_removal_distance(const tm_cut_stage *stage, const tm_world *world, int32_t tet) {
    const double *u = world->state.u_m + 3 * (int64_t)world->tissue->mesh->tet[4 * (int64_t)tet];
    return !(vdot(u, u) < stage->removal_distance_m * stage->removal_distance_m);
}

static void sweep(tm_cut_stage *stage, tm_world *world) {
    const tm_tissue *tissue = world->tissue;
    int32_t loose[LOOSE_PER_STEP], count = 0;
    for (int budget = SWEEP_PER_STEP; budget > 0 && stage->sweep_at < tissue->mesh->tet_count && count < LOOSE_PER_STEP;
         budget--) {
        const int32_t tet = stage->sweep_at++;
        const bool reached = stage->reached[tet];
        stage->visits++;
        stage->reached[tet] = 0; /* as the next search requires */
        if (!tissue->alive[tet] || reached) continue;
        if (stage->loose == TM_LOOSE_REMOVE || is_beyond_removal_distance(stage, world, tet))
            loose[count++] = tet;
        else
            stage->falling = true;
    }
    if (count > 0) remove_tet(stage, world, loose, count, -1);
    if (stage->sweep_at < tissue->mesh->tet_count) return;
    stage->state = SEARCH_IDLE;
    stage->pause = FALLING_PAUSE;
}

/* --- stage "cut search": the part of the search that removes nothing --- */

/* Continues the search. It sees the same cuts of this substep and the same jaws as the stage "cut": it runs before jaws
 * close. */
static void search_on(void *self, tm_world *world) {
    tm_cut_stage *stage = self;
    if (stage->waits && stage->state == SEARCH_IDLE)
        tm_cut_begin_search(stage, world);
    else if (stage->waits)
        tm_cut_flood(stage, world->tissue);
    stage->waits = false;
}

/* Overlaps only if no stage between the new displacements and this one might cut. */
static bool begin_overlap(void *self, tm_world *world) {
    const tm_cut_stage *stage = self;
    return stage->waits && world->group_end < world->step_count && world->entry[world->group_end].stage.self == stage;
}

/* Runs on the last thread, which has the fewest tools. */
static void work_overlap(void *self, tm_world *world, int32_t part) {
    if (part == world->partition_count - 1) search_on(self, world);
}

static const tm_overlap OVERLAP = {begin_overlap, work_overlap};

static void run(void *self, tm_world *world) {
    tm_cut_stage *stage = self;
    if (stage->visits > stage->max_visits) stage->max_visits = stage->visits;
    stage->visits = 0;
    tm_cut_update_seeds(stage, world);
    if (stage->fading.count > 0) tm_fading_age(&stage->fading, world->state.dt_s);
    cauterise(stage, world);
    switch (stage->state) {
    case SEARCH_IDLE:
        if (stage->pause > 0) stage->pause--;
        if (stage->revision != world->tissue->surface.revision || (stage->falling && stage->pause == 0))
            stage->waits = true;
        break;
    case SEARCH_REACH: stage->waits = true; break;
    case SEARCH_SWEEP: sweep(stage, world); break;
    }
}

/* --- creation, destruction, snapshots --- */

static void destroy(void *self) {
    tm_cut_stage *stage = self;
    if (stage->contact->fading == &stage->fading) tm_fading_remove(&stage->fading);
    tm_pool pool = stage->pool;
    tm_pool_release(&pool);
}

static double diagonal(const tm_mesh *mesh) {
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, d[3];
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], mesh->rest_m[i]);
        high[i % 3] = fmax(high[i % 3], mesh->rest_m[i]);
    }
    vsub(high, low, d);
    return sqrt(vdot(d, d));
}

/* Snapshot. The search restarts: only the time at which a detached fragment is found changes. */
typedef struct saved {
    double credit[TM_MAX_INSTRUMENTS];
    int32_t state, revision, pause, falling, queue_begin, queue_end, sweep_at, seed_at, fading, unused;
} saved;

static int64_t search_bytes(const tm_cut_stage *stage, const tm_tissue *tissue) {
    return stage->state == SEARCH_IDLE ? 0 : tissue->mesh->tet_count + (int64_t)sizeof(int32_t) * stage->queue_end;
}

static int64_t snapshot(void *self, void *buffer) {
    const tm_cut_stage *stage = self;
    const tm_tissue *tissue = stage->contact->world->tissue;
    const int64_t fading = (int64_t)sizeof(tm_fading_row) * stage->fading.count,
                  bytes = (int64_t)sizeof(saved) + fading + search_bytes(stage, tissue);
    if (!buffer) return bytes;
    /* Only the difference to the surface's revision is meaningful in another world. */
    const saved k = {.state = stage->state,
                     .revision = tissue->surface.revision - stage->revision,
                     .pause = stage->pause,
                     .falling = stage->falling,
                     .queue_begin = stage->queue_begin,
                     .queue_end = stage->queue_end,
                     .sweep_at = stage->sweep_at,
                     .seed_at = stage->seed_at,
                     .fading = stage->fading.count};
    char *to = buffer;
    memcpy(to, &k, sizeof k);
    memcpy(to, stage->credit, sizeof stage->credit);
    to += sizeof k;
    if (fading) memcpy(to, stage->fading.row, (size_t)fading);
    to += fading;
    if (stage->state == SEARCH_IDLE) return bytes;
    memcpy(to, stage->reached, (size_t)tissue->mesh->tet_count);
    memcpy(to + tissue->mesh->tet_count, stage->queue, sizeof(int32_t) * (size_t)stage->queue_end);
    return bytes;
}

static bool fading_fits(const tm_fading_rows *fading, const char *buffer, int64_t bytes, int32_t count) {
    const int32_t most = fading->fade_s > 0 ? TM_FADING_MAX : 0;
    bool good = count >= 0 && count <= most && bytes >= count * (int64_t)sizeof(tm_fading_row);
    for (int32_t i = 0; i < count && good; i++) {
        tm_fading_row row; /* the buffer need not be aligned */
        memcpy(&row, buffer + sizeof row * (size_t)i, sizeof row);
        good = tm_fading_fits(fading, &row);
    }
    return good;
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_cut_stage *stage = self;
    const int32_t tets = world->tissue->mesh->tet_count;
    saved k;
    if (bytes < (int64_t)sizeof k) return false;
    memcpy(&k, buffer, sizeof k);
    tm_cut_update_seeds(stage, world);
    const bool busy = k.state == SEARCH_REACH || k.state == SEARCH_SWEEP;
    if ((!busy && k.state != SEARCH_IDLE) || k.queue_begin < 0 || k.queue_end < k.queue_begin || k.queue_end > tets ||
        k.sweep_at < 0 || k.sweep_at > tets || k.seed_at < 0 || k.seed_at > stage->seed_count)
        return false;
    const char *rest = (const char *)buffer + sizeof k;
    bytes -= (int64_t)sizeof k;
    if (k.unused || !fading_fits(&stage->fading, rest, bytes, k.fading)) return false;
    const size_t fading = sizeof(tm_fading_row) * (size_t)k.fading;
    if (bytes != (int64_t)fading + (busy ? tets + (int64_t)sizeof(int32_t) * k.queue_end : 0)) return false;
    if (!apply) return true;
    stage->fading.count = k.fading;
    if (fading) memcpy(stage->fading.row, rest, fading);
    rest += fading;
    memcpy(stage->credit, k.credit, sizeof k.credit);
    stage->state = (search)k.state;
    stage->revision = world->tissue->surface.revision - k.revision;
    stage->pause = k.pause;
    stage->falling = k.falling;
    stage->queue_begin = k.queue_begin;
    stage->queue_end = k.queue_end;
    stage->sweep_at = k.sweep_at;
    stage->seed_at = k.seed_at;
    stage->log_begin = stage->log_count = 0;
    if (!busy) {
        memset(stage->reached, 0, (size_t)tets);
        return true;
    }
    memcpy(stage->reached, rest, (size_t)tets);
    memcpy(stage->queue, rest + tets, sizeof(int32_t) * (size_t)k.queue_end);
    return true;
}

static int64_t snapshot_max(const tm_mesh *mesh, double fade_s) {
    return (int64_t)sizeof(saved) + mesh->tet_count * (int64_t)(1 + sizeof(int32_t)) +
           (fade_s > 0 ? TM_FADING_MAX * (int64_t)sizeof(tm_fading_row) : 0);
}

static void checkpoint(void *self) {
    tm_cut_stage *stage = self;
    stage->saved_bytes = snapshot(stage, stage->saved);
    stage->saved_log_begin = stage->log_begin;
    stage->saved_log_count = stage->log_count;
}

static void rollback(void *self, tm_world *world) {
    tm_cut_stage *stage = self;
    restore(stage, world, stage->saved, stage->saved_bytes, true);
    stage->log_begin = stage->saved_log_begin; /* the entries of the failed step are beyond the end */
    stage->log_count = stage->saved_log_count;
}

static tm_status add_stages(tm_world *world, tm_cut_stage *self, int64_t bytes, tm_error *error) {
    const tm_stage stage[] = {{.name = "cut",
                               .phase = TM_PHASE_BEGIN,
                               .run = run,
                               .destroy = destroy,
                               .snapshot = snapshot,
                               .restore = restore,
                               .checkpoint = checkpoint,
                               .rollback = rollback,
                               .needs = {"contact"},
                               .runs_before = "contact",
                               .skip_in_settle = true,
                               .snapshot_max = snapshot_max(world->tissue->mesh, self->fading.fade_s)},
                              {.name = "cut search",
                               .phase = TM_PHASE_CONSTRAIN,
                               .run = search_on,
                               .overlap = &OVERLAP,
                               .substage_of = "cut",
                               .runs_before = tm_contact_first_stage(self->contact),
                               .skip_in_settle = true}};
    const tm_status status = tm_world_add_stages(world, stage, 2, self, bytes, error);
    if (status) return status;
    tm_world_set_few(world, "cut search", &tm_changes_none);
    return TM_OK;
}

static tm_status check(const tm_world *world, const tm_contact *contact, const tm_cut_def *def, tm_error *error) {
    if (def->loose != TM_LOOSE_FALL && def->loose != TM_LOOSE_REMOVE)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "cut: loose is %d; give a value of tm_cut_loose", (int)def->loose);
    if (!world->tissue->cuttable)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "cut: the tissue is not cuttable; set cuttable in its definition");
    if (!isfinite(def->rate_1_s) || !(def->rate_1_s > 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "cut: the rate is %g tetrahedra per second; give a positive rate",
                       def->rate_1_s);
    if (!isfinite(def->fade_s) || !(def->fade_s >= 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "cut: the fade time is %g s; give 0 or more", def->fade_s);
    if (def->fade_s > 0 && contact->others.solve)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "cut: fade_s %g s is not supported by a hybrid model; set fade_s to 0", def->fade_s);
    return TM_OK;
}

tm_status tm_stage_cut(tm_world *world, tm_contact *contact, const tm_cut_def *def, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_CUT, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && contact && contact->world == world, "world is null, or contact is not of this world",
               TM_ERR_ARGUMENT);
    tm_status status = check(world, contact, def, error);
    if (status) return status;
    const tm_mesh *mesh = world->tissue->mesh;
    tm_pool pool = {0};
    tm_cut_stage *self = TM_ALLOC(&pool, tm_cut_stage, 1);
    int32_t *log_tet = TM_ALLOC(&pool, int32_t, mesh->tet_count), *queue = TM_ALLOC(&pool, int32_t, mesh->tet_count),
            *seed = TM_ALLOC(&pool, int32_t, mesh->tet_count);
    int8_t *log_instrument = TM_ALLOC(&pool, int8_t, mesh->tet_count);
    uint8_t *reached = TM_ALLOC(&pool, uint8_t, mesh->tet_count), *is_seed = TM_ALLOC(&pool, uint8_t, mesh->tet_count),
            *fixed = TM_ALLOC(&pool, uint8_t, 3 * (int64_t)mesh->vertex_count);
    tm_fading_row *fading = def->fade_s > 0 ? TM_ALLOC(&pool, tm_fading_row, TM_FADING_MAX) : NULL;
    void *room = TM_ALLOC(&pool, char, snapshot_max(mesh, def->fade_s));
    uint8_t *keep = def->keep ? TM_ALLOC(&pool, uint8_t, mesh->tet_count) : NULL;
    if (pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "cut stage");
    }
    if (keep) memcpy(keep, def->keep, (size_t)mesh->tet_count);
    *self = (tm_cut_stage){.pool = pool,
                           .keep = keep,
                           .contact = contact,
                           .rate_1_s = def->rate_1_s,
                           .loose = def->loose,
                           .fading = {.contact = contact, .fade_s = def->fade_s, .row = fading},
                           .removal_distance_m = OUTSIDE_REMOVAL_DISTANCE * diagonal(mesh),
                           .log_tet = log_tet,
                           .log_instrument = log_instrument,
                           .reached = reached,
                           .fixed = fixed,
                           .queue = queue,
                           .seed = seed,
                           .is_seed = is_seed,
                           .supports_set = -1,
                           .saved = room,
                           .revision = world->tissue->surface.revision};
    status = add_stages(world, self, pool.bytes, error);
    if (status)
        destroy(self);
    else if (fading)
        tm_fading_add(&self->fading, self);
    return status;
}

static tm_cut_stage *find(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.run == run) return world->entry[i].stage.self;
    return NULL;
}

int32_t tm_cut_max_visits(const tm_world *world) {
    const tm_cut_stage *stage = find(world);
    return stage ? stage->max_visits : 0;
}

int32_t tm_cut_fetch_removed(tm_world *world, int32_t *tet, int8_t *instrument, int32_t max) {
    TM_REQUIRE(world && max >= 0 && (tet || max == 0), "world or tet is null, or max is negative", 0);
    tm_cut_stage *stage = find(world);
    int32_t n = 0;
    for (; stage && n < max && stage->log_count > 0; n++, stage->log_count--) {
        tet[n] = stage->log_tet[stage->log_begin];
        if (instrument) instrument[n] = stage->log_instrument[stage->log_begin];
        stage->log_begin = (stage->log_begin + 1) % world->tissue->mesh->tet_count;
    }
    return n;
}
