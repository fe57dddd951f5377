/* The model that a scene names; no other file distinguishes them. */
#include "models.h"

const sim_model_row sim_models[] = {
    [APP_DYNAMIC] = {.build = sim_build_dynamic},
    [APP_PRECOMPUTED] = {.build = sim_build_precomputed, .solves_rest = true},
    [APP_HYBRID] = {.build = sim_build_hybrid, .solves_rest = true},
};

tm_status sim_build_dynamic(sim *s) {
    tm_error error = {0};
    return sim_check_model(s, tm_model_dynamic(&s->def.model, &s->model, &error), &error);
}
