/* Exact compliance computed concurrently with a simulation. Requests and results each use three buffers: one for the
 * writer, one for the reader, and a third that one atomic exchange swaps. No thread waits for another. */
#include "factored.h"

#include <math.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Index of the buffer between writer and reader; FRESH: written since the reader's last exchange. */
enum { FRESH = 4, NICER = 5 };
typedef struct swap {
    _Atomic int middle;
    int writer, reader;
} swap;

static void swap_init(swap *s) {
    atomic_init(&s->middle, 1);
    s->writer = 0;
    s->reader = 2;
}
static void swap_put(swap *s) { s->writer = atomic_exchange(&s->middle, s->writer | FRESH) & 3; }
static bool swap_take(swap *s) {
    if (!(atomic_load(&s->middle) & FRESH)) return false;
    s->reader = atomic_exchange(&s->middle, s->reader) & 3;
    return true;
}

struct tm_compliance_factor {
    const tm_tissue *tissue;
    uint8_t *condensed; /* [tet_count] or null */
    tms_engine *engine;
    swap requests, results;
    tms_compliance_request request[3];
    tms_compliance_result result[3];
    int32_t revision[3];        /* of the tissue that requests[i].alive was copied from, -1: never */
    tms_compliance_request now; /* present request of all instruments together; `alive` unused */
    bool any;                   /* a result has been received */
    bool live;                  /* a thread runs */
    bool corotated;
    int64_t frame; /* incremented when an instrument arrives that has arrived since the last increment */
    int32_t last_owner;
    double rotation[9 * TMS_RESULT_VERTICES]; /* since the state of the last result */
    tm_compliance given;
    pthread_t thread;
    sem_t posted;
    _Atomic bool stop;
};

tm_compliance_factor_def tm_compliance_factor_def_default(void) {
    return (tm_compliance_factor_def){.cookie = TMS_COOKIE_FACTORED, .size = sizeof(tm_compliance_factor_def)};
}

static bool take_memory(tm_compliance_factor *f, const uint8_t *elsewhere) {
    const size_t tets = (size_t)tm_tissue_mesh(f->tissue)->tet_count, width = 3 * TMS_RESULT_VERTICES;
    const size_t vertices = (size_t)tm_tissue_mesh(f->tissue)->vertex_count;
    bool good = true;
    if (elsewhere) {
        f->condensed = tm_allocate(tets);
        good = f->condensed != NULL;
        if (good) memcpy(f->condensed, elsewhere, tets);
    }
    for (int i = 0; i < 3; i++) {
        f->request[i].alive = tm_allocate(tets);
        if (f->corotated) f->request[i].u_m = tm_allocate(vertices * 3 * sizeof(double));
        f->result[i].C_m_N = tm_allocate(sizeof(double) * width * width);
        f->revision[i] = -1;
        good = good && f->request[i].alive && (!f->corotated || f->request[i].u_m) && f->result[i].C_m_N;
    }
    return good;
}

tm_status tm_compliance_factor_create(const tm_compliance_factor_def *def, tm_compliance_factor **factored,
                                      tm_error *error) {
    TM_REQUIRE_DEF(def, TMS_COOKIE_FACTORED, TM_ERR_ARGUMENT);
    TM_REQUIRE(factored && def->tissue && def->fixed, "factored, def->tissue or def->fixed is null", TM_ERR_ARGUMENT);
    if (def->corotated && !(tm_tissue_rotation(def->tissue) > 0))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "the compliance factor is to be corotational, and the tissue has no rotation; set rotation in the tissue's definition");
    const char *law = tms_nonlinear_law(def->tissue);
    tm_compliance_factor *f = tm_allocate(sizeof *f);
    if (!f) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the compliance factor; use a coarser mesh");
    memset(f, 0, sizeof *f);
    f->tissue = def->tissue;
    f->corotated = def->corotated || law;
    swap_init(&f->requests);
    swap_init(&f->results);
    sem_init(&f->posted, 0, 0);
    f->engine = tms_engine_create(def->tissue, def->fixed, f->corotated);
    if (!take_memory(f, def->condensed) || !f->engine) {
        tm_compliance_factor_destroy(f);
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the compliance factor; use a coarser mesh");
    }
    *factored = f;
    return TM_OK;
}

void tm_compliance_factor_destroy(tm_compliance_factor *f) {
    if (!f) return;
    const size_t tets = (size_t)tm_tissue_mesh(f->tissue)->tet_count, width = 3 * TMS_RESULT_VERTICES;
    const size_t vertices = (size_t)tm_tissue_mesh(f->tissue)->vertex_count;
    if (f->live) {
        atomic_store(&f->stop, true);
        sem_post(&f->posted);
        pthread_join(f->thread, NULL);
    }
    sem_destroy(&f->posted);
    tms_engine_destroy(f->engine);
    tm_release(f->condensed, tets);
    for (int i = 0; i < 3; i++) {
        tm_release(f->request[i].alive, tets);
        tm_release(f->request[i].u_m, vertices * 3 * sizeof(double));
        tm_release(f->result[i].C_m_N, sizeof(double) * width * width);
    }
    tm_release(f, sizeof *f);
}

int64_t tm_compliance_factor_bytes(const tm_compliance_factor *f) {
    TM_REQUIRE(f, "factored is null", 0);
    const int64_t tets = tm_tissue_mesh(f->tissue)->tet_count, width = 3 * TMS_RESULT_VERTICES;
    const int64_t u = f->corotated ? 24 * (int64_t)tm_tissue_mesh(f->tissue)->vertex_count : 0;
    return (int64_t)sizeof *f + 3 * u + (f->condensed ? tets : 0) +
           3 * (tets + (int64_t)sizeof(double) * width * width) + tms_engine_bytes(f->engine);
}

/* --- worker thread --- */

/* Works on one request until it is complete or a newer one exists. */
static void work_off(tm_compliance_factor *f, bool whole) {
    bool more = true;
    while (more && !atomic_load(&f->stop)) {
        if (tms_engine_advance(f->engine, &f->request[f->requests.reader], whole, &f->result[f->results.writer], &more))
            swap_put(&f->results);
        if (!whole && swap_take(&f->requests)) more = true;
    }
}

static void *work(void *user) {
    tm_compliance_factor *f = user;
    setpriority(PRIO_PROCESS, (id_t)syscall(SYS_gettid), NICER); /* of this thread: frames have priority */
    while (!atomic_load(&f->stop)) {
        sem_wait(&f->posted);
        if (swap_take(&f->requests)) work_off(f, false);
    }
    return NULL;
}

tm_status tm_compliance_factor_start(tm_compliance_factor *f, tm_error *error) {
    TM_REQUIRE(f, "factored is null", TM_ERR_ARGUMENT);
    if (f->live) return TM_OK;
    if (pthread_create(&f->thread, NULL, work, f))
        return tm_fail(error, TM_ERR_LIMIT, -1,
                       "no thread can be started for the compliance factor; raise the process limit (ulimit -u)");
    f->live = true;
    return TM_OK;
}

/* --- the simulation's side --- */

static void post(tm_compliance_factor *f, const double *u_m) {
    tms_compliance_request *w = &f->request[f->requests.writer];
    const tm_mesh *mesh = tm_tissue_mesh(f->tissue);
    const int32_t revision = tm_tissue_surface(f->tissue).revision, tets = mesh->tet_count;
    if (f->revision[f->requests.writer] != revision) {
        memcpy(w->alive, tm_tissue_alive(f->tissue), (size_t)tets);
        for (int32_t t = 0; f->condensed && t < tets; t++) w->alive[t] |= f->condensed[t];
    }
    f->revision[f->requests.writer] = revision;
    if (f->corotated) memcpy(w->u_m, u_m, 3 * (size_t)mesh->vertex_count * sizeof *u_m);
    w->frame = f->frame;
    w->revision = revision;
    memcpy(w->count, f->now.count, sizeof w->count);
    memcpy(w->needed, f->now.needed, sizeof w->needed);
    memcpy(w->vertex, f->now.vertex, sizeof w->vertex);
    swap_put(&f->requests);
    if (f->live) sem_post(&f->posted);
}

/* Computes the rotation of the tissue since the newest result. */
static void turn(tm_compliance_factor *f, const tms_compliance_result *result, const double *u_m) {
    const tm_mesh *mesh = tm_tissue_mesh(f->tissue);
    for (int32_t i = 0; i < result->is.count; i++) {
        const double *from = result->frame + 9 * i;
        double to[9];
        tms_vertex_frame(mesh, tm_tissue_alive(f->tissue), u_m, result->vertex[i], to);
        for (int k = 0; k < 9; k++) {
            const double *a = to + 3 * (k / 3), *b = from + 3 * (k % 3);
            f->rotation[9 * i + k] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        }
    }
    f->given.rotation = f->rotation;
}

static const tm_compliance *exchange(void *self, int32_t owner, const tm_compliance_request *request) {
    tm_compliance_factor *f = self;
    TM_REQUIRE(f && request && owner >= 0 && owner < TM_MAX_INSTRUMENTS && request->count >= 0 &&
                   request->count <= TM_COMPLIANCE_REQUEST_MAX && request->needed >= 0 &&
                   request->needed <= request->count && (request->vertex || request->count == 0) &&
                   (request->u_m || !f->corotated),
               "self, request, its vertex or u_m is null, or owner, count or needed is out of range", NULL);
    for (int32_t i = 0; i < request->count; i++)
        TM_REQUIRE(request->vertex[i] >= 0 && request->vertex[i] < tm_tissue_mesh(f->tissue)->vertex_count,
                   "no such vertex", NULL);
    f->frame += owner <= f->last_owner;
    f->last_owner = owner;
    f->now.count[owner] = request->count;
    f->now.needed[owner] = request->needed;
    if (request->count) memcpy(f->now.vertex[owner], request->vertex, sizeof *request->vertex * (size_t)request->count);
    post(f, request->u_m);
    /* Without a thread it is computed now, completely: the same calls, the same bits. */
    if (!f->live && swap_take(&f->requests)) work_off(f, true);
    f->any = swap_take(&f->results) || f->any;
    if (!f->any) return NULL;
    const tms_compliance_result *result = &f->result[f->results.reader];
    f->given = result->is;
    if (f->corotated) turn(f, result, request->u_m);
    return &f->given;
}

static tm_status begin_thread(void *self, tm_error *error) { return tm_compliance_factor_start(self, error); }

tm_compliance_source tm_compliance_factor_source(tm_compliance_factor *factored) {
    TM_REQUIRE(factored, "factored is null", (tm_compliance_source){0});
    return (tm_compliance_source){
        .self = factored, .exchange = exchange, .start = begin_thread, .corotated = factored->corotated};
}

static void destroy(void *self) { tm_compliance_factor_destroy(self); }

tm_compliance_source tm_compliance_factor_owned_source(tm_compliance_factor *factored) {
    TM_REQUIRE(factored, "factored is null", (tm_compliance_source){0});
    tm_compliance_source source = tm_compliance_factor_source(factored);
    source.destroy = destroy;
    return source;
}
