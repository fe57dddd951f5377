/* Exact compliance for patches of the dynamic model, from the module `solve`: opened only where a controller may ask
 * for stiffness or patch. */
#include "exact.h"

#include <stdlib.h>

#include "solve_api.h"

struct sim_exact {
    sim_factored_api api;
    tm_factored *factored;
};

int sim_exact_open(sim *s, int line, tm_compliance_source *source) {
    tm_error error = {0};
    sim_problem problem = {0};
    s->exact = calloc(1, sizeof *s->exact);
    if (!s->exact) return app_scene_bad(s->scene, line, "out of memory; use a smaller mesh");
    int rc = sim_open_factored(s, line, &s->exact->api);
    tm_solve_def unused;
    if (!rc) rc = sim_problem_make(s, s->tissue, &problem, &unused);
    if (!rc) {
        tm_factored_def def = s->exact->api.tm_factored_def_default_();
        def.tissue = s->tissue;
        def.fixed = problem.fixed;
        if (s->exact->api.tm_factored_create_(&def, &s->exact->factored, &error))
            rc = sim_report(s->scene, line, &error);
    }
    sim_problem_free(&problem);
    if (!rc) *source = s->exact->api.tm_factored_source_(s->exact->factored);
    return rc;
}

int sim_exact_start(sim *s) {
    tm_error error = {0};
    if (!s->exact || !s->exact->api.tm_factored_start_(s->exact->factored, &error)) return 0;
    return sim_report(s->scene, 0, &error);
}

void sim_exact_close(sim *s) {
    if (!s->exact) return;
    if (s->exact->factored) s->exact->api.tm_factored_destroy_(s->exact->factored);
    free(s->exact);
    s->exact = NULL;
}
