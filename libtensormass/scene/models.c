/* Which model a scene names: the one place that knows them apart. */
#include "models.h"

const sim_model_row sim_models[] = {
    [APP_DYNAMIC] = {.make = sim_make_dynamic},
    [APP_PRECOMPUTED] = {.make = sim_make_precomputed, .solves_rest = true},
    [APP_HYBRID] = {.make = sim_make_hybrid, .solves_rest = true},
};

tm_status sim_make_dynamic(sim *s) {
    tm_error error = {0};
    return sim_model_made(s, tm_model_dynamic(&s->def.model, &s->model, &error), &error);
}
