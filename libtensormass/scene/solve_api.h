/* libtensormass_solve through the module `solve`, opened only by scenes whose model is precomputed or hybrid, or whose
 * controllers want exact compliance. */
#ifndef TM_SIM_SOLVE_API_H
#define TM_SIM_SOLVE_API_H

#include "sim.h"
#include "tensormass_solve.h"

/* It moves lists of macros about for ever. */
/* clang-format off */
#define SIM_SOLVE(F) \
    F(tm_precomputed_def_default) F(tm_model_precomputed) F(tm_model_precompute) \
    F(tm_hybrid_def_default) F(tm_model_hybrid) \
    F(tm_factored_def_default) F(tm_factored_create) F(tm_factored_destroy) F(tm_factored_given)
/* clang-format on */
#define SIM_SOLVE_POINTER(name) __typeof__(name) *name##_;

typedef struct sim_solve_api {
    SIM_SOLVE(SIM_SOLVE_POINTER)
} sim_solve_api;

bool sim_solve_open(const app_host *host, sim_solve_api *api, tm_error *error);

/* Options of `precomputed` and, all but the first, of `hybrid`. */
typedef struct sim_solve_options {
    app_section here;
    app_choice solver, precision;
    app_flag cache;
    app_integer max_vertices;
    app_text region; /* hybrid */
    app_section box;
    app_vector box_min, box_max;
    app_flag smooth;
} sim_solve_options;

/* Where the result is kept, made from what it depends on in name and folder; empty: nowhere. The library checks the
 * contents. */
void sim_solve_file(const sim *s, const sim_solve_options *o, const char *kind, char *path, size_t size);
void sim_solve_told(const sim *s, const char *what, const tm_solve_report *report);

#endif
