/* Precomputed model: quasi-static, one update per frame. */
#include "choices.h"
#include "models.h"
#include "solve_api.h"

#define OPTION(member) offsetof(sim_solve_options, member), 0

#define SOLVERS(ROW) ROW("cholesky", TM_SOLVER_CHOLESKY) ROW("cg", TM_SOLVER_CG)
APP_CHOICE_CHECK(SOLVERS)

static const app_field fields[] = {
    {"precomputed", APP_SECTION, NULL, NULL, 0, 0, OPTION(here),
     "settings of `model: precomputed`; without that model the section has no effect"},
    {"precomputed.solver", APP_CHOICE, APP_CHOICE_WORDS(SOLVERS), "cholesky", 0, 0, OPTION(solver),
     "`cholesky`: CHOLMOD; `cg`: conjugate gradients, as in the paper"},
    {"precomputed.precision", APP_CHOICE, APP_CHOICE_WORDS(APP_PRECISIONS), "double", 0, 0, OPTION(precision),
     "precision of the stored responses"},
    {"precomputed.cache", APP_FLAG, NULL, "yes", 0, 0, OPTION(cache),
     "store the responses on disk: in $TM_CACHE_DIR, $XDG_CACHE_HOME/tensormass or ~/.cache/tensormass"},
    {"precomputed.max_vertices", APP_INTEGER, NULL, "256", 8, 4096, OPTION(max_vertices),
     "largest number of vertices in contact"},
};

tm_status sim_build_precomputed(sim *s) {
    const sim_solve_options *o = sim_options(s->scene, "precomputed");
    sim_solve_api api;
    char path[SIM_SOLVE_PATH];
    tm_error error = {0};
    tm_solve_report report = {0};
    if (!sim_solve_open(&s->scene->host, &api, &error)) return sim_report(s->scene, s->scene->model.line, &error);
    tm_precomputed_def how = api.tm_precomputed_def_default_();
    sim_solve_set(s, o, "precomputed", path,
                  &(sim_solve_members){&how.problem, &how.precision, &how.max_contact_vertices, &how.file});
    const tm_status rc =
        sim_check_model(s, api.tm_model_precomputed_(&s->def.model, &how, &s->model, &report, &error), &error);
    if (!rc) sim_solve_told(s, "the precomputed model", &report);
    return rc;
}

const sim_effect sim_effect_precomputed = {
    .name = "precomputed",
    .doc = "`model: precomputed` uses it: responses of the surface to unit forces, solved once and stored on "
           "disk; contact is then a small system. Quasi-static: mass and damping have no effect, and nothing "
           "can be cut. Opens the module `solve` (CHOLMOD).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_solve_options)},
    .model = APP_PRECOMPUTED,
    .excludes = {{"cut",
                  "its responses are valid only for uncut tissue; write 'model: dynamic', or 'model: hybrid' with the "
                  "part to cut under 'hybrid:'"},
                 {"breathing", "its supports cannot move; write 'model: dynamic'"}},
};
