/* Effect `gravity`: weight of the tissue. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_vector acceleration;
} options;

static const app_field fields[] = {
    {"gravity", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "the tissue has weight"},
    {"gravity.acceleration", APP_VECTOR, "acceleration", "[0, 0, -9.81]", 0, 0, offsetof(options, acceleration), 0,
     "world axes"},
};

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    s->def.model.gravity_m_s2 = o->acceleration.v;
    return 0;
}

const sim_effect sim_effect_gravity = {
    .name = "gravity",
    .doc = "Weight. It acts from the start at full size; `--settle` gives the shape in equilibrium.",
    .example = "{acceleration: [0, 0, -9.81]}",
    .trial = SIM_TRIAL_DROP_OR_ADD,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .prepare = prepare,
};
