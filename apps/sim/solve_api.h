/* libtensormass_solve through the module `solve`, opened only by scenes whose model is precomputed or hybrid. */
#ifndef TM_SIM_SOLVE_API_H
#define TM_SIM_SOLVE_API_H

#include "sim.h"
#include "tensormass_solve.h"

/* It moves lists of macros about for ever. */
/* clang-format off */
#define SIM_SOLVE_PRECOMPUTED(F) \
    F(tm_precomputed_def_default) F(tm_precomputed_create) F(tm_precomputed_write) F(tm_precomputed_destroy) F(tm_precomputed_bytes) \
    F(tm_precomputed_update) F(tm_precomputed_place) F(tm_precomputed_force) F(tm_precomputed_reaction) \
    F(tm_precomputed_rows) F(tm_precomputed_displacement) F(tm_precomputed_patch) F(tm_solve_static)
#define SIM_SOLVE_HYBRID(F) \
    F(tm_hybrid_def_default) F(tm_hybrid_create) F(tm_hybrid_destroy) F(tm_hybrid_bytes) F(tm_hybrid_tissue) \
    F(tm_hybrid_critical_step) F(tm_stage_hybrid) F(tm_hybrid_recover) F(tm_hybrid_reaction) F(tm_hybrid_patch) \
    F(tm_hybrid_surface)
#define SIM_SOLVE_FACTORED(F) \
    F(tm_factored_def_default) F(tm_factored_create) F(tm_factored_destroy) F(tm_factored_source) F(tm_factored_start)
/* clang-format on */
#define SIM_SOLVE_POINTER(name) __typeof__(name) *name##_;

typedef struct sim_precomputed_api {
    SIM_SOLVE_PRECOMPUTED(SIM_SOLVE_POINTER)
} sim_precomputed_api;
typedef struct sim_hybrid_api {
    SIM_SOLVE_HYBRID(SIM_SOLVE_POINTER)
} sim_hybrid_api;
typedef struct sim_factored_api {
    SIM_SOLVE_FACTORED(SIM_SOLVE_POINTER)
} sim_factored_api;

/* 0 or an exit code, having complained and blamed the scene's `model` line, or the one that is given. */
int sim_open_precomputed(const sim *s, sim_precomputed_api *api);
int sim_open_hybrid(const sim *s, sim_hybrid_api *api);
int sim_open_factored(const sim *s, int line, sim_factored_api *api);

/* The static problem of a scene: tissue, supports, loads with gravity, progress. Memory of the sim: free with
 * sim_problem_free. */
typedef struct sim_problem {
    uint8_t *fixed;
    double *value_m, *load_N;
} sim_problem;
int sim_problem_make(const sim *s, const tm_tissue *tissue, sim_problem *p, tm_solve_def *def);
void sim_problem_free(sim_problem *p);

/* Options of `precomputed` and, all but the first, of `hybrid`. */
typedef struct sim_solve_options {
    app_section here;
    app_choice solver, precision;
    app_flag cache;
    app_integer max_vertices;
    app_text region; /* hybrid */
    app_section box;
    app_vector box_min, box_max;
} sim_solve_options;

/* Where the result is kept, made from what it depends on in name and folder; empty: nowhere. The library checks the
 * contents. */
void sim_solve_file(const sim *s, const sim_solve_options *o, const char *kind, char *path, size_t size);
void sim_solve_told(const sim *s, const char *what, const tm_solve_report *report);

#endif
