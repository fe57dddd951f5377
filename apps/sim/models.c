/* Which model a scene names: the one place that knows them apart. */
#include "models.h"

const sim_model_row sim_models[] = {
    [APP_DYNAMIC] = {.make = sim_make_dynamic},
    [APP_PRECOMPUTED] = {.make = sim_make_precomputed},
    [APP_HYBRID] = {.make = sim_make_hybrid,
                    .not_settled = "--settle relaxes a whole tissue, not a hybrid one; write 'model: dynamic' (the "
                                   "same shape at rest) or 'model: precomputed'"},
};

int sim_make_dynamic(sim *s) {
    tm_error error = {0};
    return sim_model_made(s, tm_model_dynamic(&s->def.model, &s->model, &error), &error);
}
