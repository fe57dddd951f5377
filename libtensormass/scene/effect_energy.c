/* Effect `energy`: energy balance of the tissue. */
#include "sim.h"

typedef struct options {
    app_section here;
} options;

static const app_field fields[] = {
    {"energy", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "an account of energy: hands, supports, weight, damping, cuts"},
};

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    return tm_stage_energy(s->model->world, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const sim_effect sim_effect_energy = {
    .name = "energy",
    .doc = "What went into the tissue and what came out, in joules, in the report of a run (`--json FILE`, `energy`). "
           "It closes to rounding (`residual_J`); `generated_J` says whether contact made any out of nothing.",
    .example = "",
    .trial = SIM_TRIAL_KEEP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "it has neither mass nor motion; write 'model: dynamic'"},
                 {"hybrid", "its condensed part has neither mass nor motion; write 'model: dynamic'"}},
    .build = build,
};
