/* Messages, memory, clock, processors, numbers in snapshots. */
#include "internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

tm_status tms_check_precision(tm_precision precision, tm_error *error) {
    if (precision == TM_DOUBLE || precision == TM_SINGLE) return TM_OK;
    return tm_fail(error, TM_ERR_ARGUMENT, -1, "precision is %d; give a value of tm_precision", (int)precision);
}

tm_status tms_check_problem(const tm_solve_def *def, tm_error *error) {
    if (def->solver != TM_SOLVER_CHOLESKY && def->solver != TM_SOLVER_CG)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "solver is %d; give a value of tm_solver", (int)def->solver);
    if (!(def->cg_tolerance > 0) || !isfinite(def->cg_tolerance) || def->cg_max_iterations < 1 || def->threads < 0 ||
        def->memory_limit_bytes < 0)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "tolerance %g, %d iterations, %d threads, memory limit %lld bytes; give a positive tolerance and "
            "number of iterations, and nothing negative",
            def->cg_tolerance, (int)def->cg_max_iterations, (int)def->threads, (long long)def->memory_limit_bytes);
    const tm_mesh *mesh = tm_tissue_mesh(def->tissue);
    const tm_law_kind law = (tm_law_kind)tm_tissue_tet_material(def->tissue, 0)->law;
    if (law != TM_LAW_LINEAR)
        return tm_fail(
            error, TM_ERR_EXCLUDED, -1,
            "static solutions and responses support only the linear law, and a material has the law %s; choose the dynamic model",
            tm_law_name(law));
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++) {
        const int32_t vertex = tm_mesh_original_vertex(mesh, d / 3);
        if (def->fixed[d] && def->fixed_value_m && !tm_is_place(def->fixed_value_m[d]))
            return tm_fail(error, TM_ERR_ARGUMENT, vertex, "vertex %d is fixed at %g m; give a finite displacement",
                           (int)vertex, def->fixed_value_m[d]);
        if (def->load_N && !isfinite(def->load_N[d]))
            return tm_fail(error, TM_ERR_ARGUMENT, vertex, "the load on vertex %d is %g N; give a finite force",
                           (int)vertex, def->load_N[d]);
    }
    return TM_OK;
}

enum { HEADER = 64 }; /* before the memory: its size; keeps the alignment */

void *tms_alloc(size_t bytes) {
    if (bytes > SIZE_MAX / 4) return NULL;
    const size_t whole = HEADER + bytes;
    char *block = tm_allocate(whole);
    if (!block) return NULL;
    memcpy(block, &whole, sizeof whole);
    return block + HEADER;
}

void *tms_alloc_zeroed(size_t count, size_t size) {
    void *memory = size && count > SIZE_MAX / 4 / size ? NULL : tms_alloc(count * size);
    if (memory) memset(memory, 0, count * size);
    return memory;
}

void tms_free(void *memory) {
    if (!memory) return;
    char *block = (char *)memory - HEADER;
    size_t whole;
    memcpy(&whole, block, sizeof whole);
    tm_release(block, whole);
}

double tms_clock_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int32_t tms_threads(const tm_solve_def *def) {
    if (def->solver == TM_SOLVER_CHOLESKY && !tms_blas_is_parallel()) return 1;
    if (def->threads > 0) return def->threads;
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    return cores < 1 ? 1 : cores > 64 ? 64 : (int32_t)cores;
}

void tms_bytes_text(int64_t bytes, char text[32]) {
    if (bytes >= 1000000000)
        snprintf(text, 32, "%.1f GB", (double)bytes * 1e-9);
    else if (bytes >= 1000000)
        snprintf(text, 32, "%.0f MB", (double)bytes * 1e-6);
    else
        snprintf(text, 32, "%.0f kB", (double)bytes * 1e-3);
}

bool tms_progress(const tm_solve_def *def, const char *what, double fraction, double seconds_left) {
    return !def->progress || def->progress(def->user, what, fraction, seconds_left);
}

tm_solve_def tm_solve_def_default(void) {
    return (tm_solve_def){
        .cookie = TMS_COOKIE_PROBLEM, .size = sizeof(tm_solve_def), .cg_tolerance = 1e-11, .cg_max_iterations = 20000};
}

bool tms_are_below(const void *from, size_t count, double most) {
    for (size_t i = 0; i < count; i++) {
        double value;
        memcpy(&value, (const char *)from + 8 * i, 8);
        if (!(fabs(value) < most)) return false;
    }
    return true;
}
