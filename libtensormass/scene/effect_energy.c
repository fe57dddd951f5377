/* Effect `energy`: energy balance of the tissue. */
#include "sim.h"

typedef struct options {
    app_section here;
} options;

static const app_field fields[] = {
    {"energy", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "an energy account: hands, supports, weight, damping, cuts"},
};

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    return tm_stage_energy(s->model->world, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const sim_effect sim_effect_energy = {
    .name = "energy",
    .doc = "Energy that entered and left the tissue, J, in the report of a run (`--json FILE`, `energy`). It "
           "balances to rounding (`residual_J`); `generated_J` is the energy that contact generated.",
    .example = "",
    .trial = SIM_TRIAL_KEEP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "it has neither mass nor motion; write 'model: dynamic'"},
                 {"hybrid", "its condensed part has neither mass nor motion; write 'model: dynamic'"}},
    .build = build,
};
