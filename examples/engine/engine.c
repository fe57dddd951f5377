/* An engine with soft organs: its own loop, memory and jobs, and libtensormass between them.
 *
 *     cc -O2 engine.c $(pkg-config --cflags --libs tensormass_io) -lpthread -lm -o engine && ./engine
 * meshes/liver_1k.msh 3
 *
 * The interfaces that an engine needs: tm_set_allocator (the library allocates only from the engine's arena, never
 * in a frame), tm_model_frame (a frame is one call, so an organ is a job), tm_model_def.parallel_for (the partitions
 * of a step are jobs), and tm_model_surface (triangles to draw). */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tensormass.h>
#include <tensormass_io.h>

/* --- the engine: memory. Blocks of powers of two from one arena; a free call passes the block's size. --- */

enum { ARENA = 64 << 20, CLASSES = 32 };
static _Alignas(64) unsigned char arena[ARENA];
static size_t arena_used, arena_live;
static void *arena_free[CLASSES];
static int arena_closed; /* set during a frame: no allocation is permitted */

static int size_class(size_t bytes) {
    int c = 6; /* 64 bytes, the alignment that the library requires */
    while (((size_t)1 << c) < bytes) c++;
    return c;
}

static void *arena_alloc(size_t bytes, void *user) {
    const int c = size_class(bytes);
    void *block = arena_free[c];
    (void)user;
    if (arena_closed) abort();
    if (block)
        memcpy(&arena_free[c], block, sizeof block);
    else if (ARENA - arena_used >= (size_t)1 << c)
        block = arena + arena_used, arena_used += (size_t)1 << c;
    if (block) arena_live += bytes;
    return block; /* null: the library returns TM_ERR_MEMORY */
}

static void arena_release(void *block, size_t bytes, void *user) {
    const int c = size_class(bytes);
    (void)user;
    memcpy(block, &arena_free[c], sizeof block);
    arena_free[c] = block;
    arena_live -= bytes;
}

/* --- the engine: jobs. Workers take the next one of a batch; the thread that starts the batch helps and waits. --- */

static struct {
    pthread_mutex_t lock;
    pthread_cond_t more, done;
    void (*work)(void *, int32_t);
    void *context;
    int32_t next, count, left, over;
} jobs = {.lock = PTHREAD_MUTEX_INITIALIZER, .more = PTHREAD_COND_INITIALIZER, .done = PTHREAD_COND_INITIALIZER};

/* Runs one waiting job, if there is one; call with the lock held. */
static int take_one(void) {
    if (jobs.next == jobs.count) return 0;
    const int32_t part = jobs.next++;
    pthread_mutex_unlock(&jobs.lock);
    jobs.work(jobs.context, part);
    pthread_mutex_lock(&jobs.lock);
    if (--jobs.left == 0) pthread_cond_broadcast(&jobs.done);
    return 1;
}

static void *worker(void *unused) {
    pthread_mutex_lock(&jobs.lock);
    while (!jobs.over)
        if (!take_one()) pthread_cond_wait(&jobs.more, &jobs.lock);
    pthread_mutex_unlock(&jobs.lock);
    return unused;
}

/* A tm_parallel_for: the partitions of a step are jobs like others. */
static void jobs_run(void *user, void (*work)(void *, int32_t), void *context, int32_t count) {
    (void)user;
    pthread_mutex_lock(&jobs.lock);
    jobs.work = work, jobs.context = context, jobs.next = 0, jobs.count = jobs.left = count;
    pthread_cond_broadcast(&jobs.more);
    while (take_one()) continue;
    while (jobs.left) pthread_cond_wait(&jobs.done, &jobs.lock);
    pthread_mutex_unlock(&jobs.lock);
}

/* --- the engine's data of an organ --- */

typedef struct organ {
    tm_mesh *mesh;
    tm_model *model;
    tm_tool_pose tool;
    float *vertex;  /* [3*vertex_count] positions for the renderer; their triangles are tm_model_surface's */
    double force_N; /* the force that a hand would feel, upwards */
    tm_status status;
} organ;

static int organ_make(organ *o, const char *path, double young_Pa, int threads) {
    tm_error error = {0};
    tm_mesh_file file;
    tm_material material;
    if (tm_mesh_file_load(path, 1, &file, &error)) return fprintf(stderr, "%s\n", error.message), 0;
    tm_status status = tm_mesh_file_build(&file, &o->mesh, &error);
    tm_mesh_file_free(&file);
    if (status || tm_material_young(young_Pa, 0.45, &material, &error))
        return fprintf(stderr, "%s\n", error.message), 0;
    material.density_kg_m3 = 1060, material.damping_1_s = 60;
    const int32_t n = o->mesh->vertex_count, regions = o->mesh->region_count;
    const double *x = o->mesh->rest_m, *top = x, *low = x;
    for (int32_t v = 0; v < n; v++) {
        if (x[3 * v + 2] > top[2]) top = x + 3 * v;
        if (x[3 * v + 2] < low[2]) low = x + 3 * v;
    }
    int32_t *dof = malloc(3 * sizeof *dof * (size_t)n), *first = calloc((size_t)regions, sizeof *first), held = 0;
    double *zero = calloc(3 * (size_t)n, sizeof *zero);
    for (int32_t i = 0; i < 3 * n; i++) /* supported at its lowest quarter */
        if (x[3 * (i / 3) + 2] < low[2] + 0.25 * (top[2] - low[2])) dof[held++] = i;
    tm_instrument_def probe = {.mode = TM_TOOL_PROBE,
                               .trocar_m = {top[0], top[1], top[2] + 0.2},
                               .radius_m = 0.004,
                               .contact_length_m = 0.1,
                               .pose = {.active = true}};
    memcpy(probe.pose.tip_m, (double[3]){top[0], top[1], top[2] + 0.005}, sizeof probe.pose.tip_m);
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &probe;
    tm_model_def def = tm_model_def_default();
    def.tissue.mesh = o->mesh, def.tissue.material_count = 1, def.tissue.material = &material;
    def.tissue.region_material = first; /* the same material for all regions */
    def.support_count = held, def.support_dof = dof, def.support_m = zero;
    def.contact = &contact, def.frame_s = 1.0 / 60;
    def.threads = threads, def.parallel_for = threads > 1 ? jobs_run : NULL;
    status = tm_model_dynamic(&def, &o->model, &error); /* copies everything but the mesh */
    if (status) fprintf(stderr, "%s: %s\n", path, error.message);
    o->tool = probe.pose;
    o->vertex = malloc(3 * sizeof *o->vertex * (size_t)n);
    free(dof), free(first), free(zero);
    return status == TM_OK;
}

/* The job: a frame, and its data for the renderer. Accesses this organ only. */
static void organ_frame(void *organs, int32_t i) {
    organ *o = (organ *)organs + i;
    o->status = tm_model_frame(o->model, &o->tool); /* on failure nothing has changed */
    const double *u = tm_model_displacement(o->model);
    for (int32_t i = 0; i < 3 * o->mesh->vertex_count; i++) o->vertex[i] = (float)(o->mesh->rest_m[i] + u[i]);
    o->force_N = tm_model_reaction(o->model, 0).force_N[2];
}

/* --- the engine: its loop. Engine frames have any duration; organs have frames of constant length. --- */

enum { ORGANS = 3, WORKERS_MAX = 16 };

int main(int count, char **word) {
    static organ organs[ORGANS];
    static const double ticks_s[] = {0.016, 0.017, 0.033, 0.008, 0.016}; /* durations measured by the engine's clock */
    const int workers = count == 3 ? atoi(word[2]) : 0;
    const int divided =
        workers > ORGANS; /* more workers than organs: they share the steps of one organ after another */
    pthread_t thread[WORKERS_MAX];
    if (workers < 1 || workers > WORKERS_MAX) return fprintf(stderr, "usage: engine MESH WORKERS (1 to 16)\n"), 2;
    tm_set_allocator(&(tm_allocator){arena_alloc, arena_release, NULL});
    for (int i = 0; i < ORGANS; i++)
        if (!organ_make(&organs[i], word[1], 3e3 + 2e3 * i, divided ? workers : 1)) return 1;
    for (int i = 1; i < workers; i++) pthread_create(&thread[i], NULL, worker, NULL);
    double due_s = 0, most_N[ORGANS] = {0};
    arena_closed = 1;
    for (int tick = 0, frames = 0; tick < 40; tick++)
        for (due_s += ticks_s[tick % 5]; due_s >= 1.0 / 60; due_s -= 1.0 / 60, frames++) {
            for (int i = 0; i < ORGANS; i++) organs[i].tool.tip_m[2] -= frames < 30 ? 0.0005 : 0; /* the workers */
            if (!divided) jobs_run(NULL, organ_frame, organs, ORGANS);
            for (int i = 0; divided && i < ORGANS; i++) organ_frame(organs, i);
            for (int i = 0; i < ORGANS; i++) {
                if (organs[i].status) return fprintf(stderr, "organ %d: %s\n", i, tm_status_name(organs[i].status)), 1;
                if (organs[i].force_N > most_N[i]) most_N[i] = organs[i].force_N;
            }
        }
    arena_closed = 0;
    pthread_mutex_lock(&jobs.lock);
    jobs.over = 1;
    pthread_cond_broadcast(&jobs.more);
    pthread_mutex_unlock(&jobs.lock);
    for (int i = 1; i < workers; i++) pthread_join(thread[i], NULL);
    for (int i = 0; i < ORGANS; i++) {
        printf("organ %d: %.0f Pa, at most %.3f N, %d triangles, state %016llx\n", i, 3e3 + 2e3 * i, most_N[i],
               (int)tm_model_surface(organs[i].model).count, (unsigned long long)tm_model_hash(organs[i].model));
        tm_model_destroy(organs[i].model);
        tm_mesh_destroy(organs[i].mesh);
        free(organs[i].vertex);
    }
    return arena_live != 0;
}
