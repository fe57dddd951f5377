#include "solve_api.h"

#include "common/cache.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "run.h"

/* OpenBLAS, which the module brings, maps 128 MB as it is opened, and where it cannot it tries for ever. */
static bool has_room(void) {
    const size_t bytes = (size_t)256 << 20;
    void *all = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (all == MAP_FAILED) return false;
    munmap(all, bytes);
    return true;
}

static int open_all(const sim *s, int line, const char *const *name, void **pointer, int count) {
    tm_error error = {0};
    /* The module never uses more than one thread of OpenBLAS in each of its own. */
    setenv("OPENBLAS_NUM_THREADS", "1", 0);
    if (!has_room())
        return app_scene_bad(s->scene, line,
                             "this process may not have the 256 MB of address space that the module solve wants; raise "
                             "the limit (ulimit -v)");
    void *module = app_module("solve", &error);
    for (int i = 0; module && i < count; i++) {
        pointer[i] = app_module_symbol(module, name[i], &error);
        if (!pointer[i]) module = NULL;
    }
    return module ? 0 : app_scene_bad(s->scene, line, "%s", error.message);
}

#define SIM_SOLVE_NAME(name) #name,

int sim_open_precomputed(const sim *s, sim_precomputed_api *api) {
    static const char *const name[] = {SIM_SOLVE_PRECOMPUTED(SIM_SOLVE_NAME)};
    return open_all(s, s->scene->model.line, name, (void **)api, sizeof name / sizeof name[0]);
}

int sim_open_hybrid(const sim *s, sim_hybrid_api *api) {
    static const char *const name[] = {SIM_SOLVE_HYBRID(SIM_SOLVE_NAME)};
    return open_all(s, s->scene->model.line, name, (void **)api, sizeof name / sizeof name[0]);
}

int sim_open_factored(const sim *s, int line, sim_factored_api *api) {
    static const char *const name[] = {SIM_SOLVE_FACTORED(SIM_SOLVE_NAME)};
    return open_all(s, line, name, (void **)api, sizeof name / sizeof name[0]);
}

static bool on_progress(void *user, const char *what, double fraction, double seconds_left) {
    (void)user;
    (void)seconds_left;
    app_progress(what, fraction, fraction >= 1);
    return !app_interrupted();
}

int sim_problem_make(const sim *s, const tm_tissue *tissue, sim_problem *p, tm_solve_def *def) {
    size_t n = 3 * (size_t)s->mesh->vertex_count;
    *p = (sim_problem){calloc(n, 1), calloc(n, sizeof(double)), calloc(n, sizeof(double))};
    if (!p->fixed || !p->value_m || !p->load_N) {
        sim_problem_free(p);
        return app_scene_bad(s->scene, s->scene->model.line, "out of memory; use a smaller mesh");
    }
    for (int32_t i = 0; i < s->held_count; i++) {
        p->fixed[s->held_dof[i]] = 1;
        p->value_m[s->held_dof[i]] = s->held_m[i];
    }
    const double *mass = tm_tissue_mass_kg(tissue);
    for (int32_t v = 0; v < s->mesh->vertex_count; v++)
        for (int a = 0; a < 3; a++)
            p->load_N[3 * v + a] = (s->load_N ? s->load_N[3 * v + a] : 0) + mass[v] * s->gravity_m_s2[a];
    def->tissue = tissue;
    def->fixed = p->fixed;
    def->fixed_value_m = p->value_m;
    def->load_N = p->load_N;
    def->progress = on_progress;
    return 0;
}

void sim_problem_free(sim_problem *p) {
    free(p->fixed);
    free(p->value_m);
    free(p->load_N);
    *p = (sim_problem){0};
}

void sim_solve_file(const sim *s, const sim_solve_options *o, const char *kind, char *path, size_t size) {
    char folder[900];
    path[0] = 0;
    if (!o->cache.on || !app_cache_folder(folder, sizeof folder)) return;
    /* Scenes that differ in anything else than these would only overwrite each other's file, never read it wrongly. */
    uint64_t key = tm_hash(&s->file.hash, sizeof s->file.hash, TM_HASH_SEED);
    for (int32_t r = 0; r < s->mesh->region_count; r++) {
        tm_material at_rest = s->material[r];
        at_rest.damping_1_s = 0; /* plays no part */
        key = tm_hash(&at_rest, sizeof at_rest, key);
    }
    if (o->region.line) key = tm_hash(o->region.s, strlen(o->region.s), key);
    if (o->box.line) key = tm_hash(o->box_min.v, sizeof o->box_min.v, tm_hash(o->box_max.v, sizeof o->box_max.v, key));
    key = tm_hash(s->held_dof, sizeof *s->held_dof * (size_t)s->held_count, key);
    key = tm_hash(&o->solver.index, sizeof o->solver.index, key);
    key = tm_hash(&o->precision.index, sizeof o->precision.index, key);
    if (s->fibre) key = tm_hash(s->fibre, sizeof *s->fibre * 3 * (size_t)s->mesh->tet_count, key);
    snprintf(path, size, "%s/%s-%016llx.tms", folder, kind, (unsigned long long)key);
}

void sim_solve_told(const sim *s, const char *what, const tm_solve_report *r) {
    if (r->from_file) return;
    app_remark("%s: %s computed in %.1f s (%d columns, %.1f MB; %s)\n", s->scene->file, what, r->seconds, r->columns,
               (double)r->responses_bytes * 1e-6, r->why);
}
