/* libtensormass_solve through the module `solve`. Only scenes with a precomputed or hybrid model, or controllers with
 * exact compliance, open it. */
#ifndef TM_SIM_SOLVE_API_H
#define TM_SIM_SOLVE_API_H

#include "sim.h"
#include "tensormass_solve.h"

/* clang-format does not converge on lists of macros. */
/* clang-format off */
#define SIM_SOLVE(F) \
    F(tm_precomputed_def_default) F(tm_model_precomputed) F(tm_model_precompute) \
    F(tm_hybrid_def_default) F(tm_model_hybrid) \
    F(tm_compliance_factor_def_default) F(tm_compliance_factor_create) F(tm_compliance_factor_destroy) F(tm_compliance_factor_owned_source)
/* clang-format on */
#define SIM_SOLVE_POINTER(name) __typeof__(name) *name##_;

typedef struct sim_solve_api {
    SIM_SOLVE(SIM_SOLVE_POINTER)
} sim_solve_api;

bool sim_solve_open(const app_host *host, sim_solve_api *api, tm_error *error);

/* Options of `precomputed`; `hybrid` has all but the first. */
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

/* Members that the definitions of both models share. */
typedef struct sim_solve_members {
    tm_solve_def *problem;
    tm_precision *precision;
    int32_t *max_vertices;
    const char **file;
} sim_solve_members;

enum { SIM_SOLVE_PATH = 1024 };
/* Sets the members from a scene's options. `path` receives the file's name, which depends on `kind` and on the inputs
 * of the result. A null file means that the scene stores none. */
void sim_solve_set(const sim *s, const sim_solve_options *o, const char *kind, char path[SIM_SOLVE_PATH],
                   const sim_solve_members *to);
void sim_solve_told(const sim *s, const char *what, const tm_solve_report *report);

#endif
