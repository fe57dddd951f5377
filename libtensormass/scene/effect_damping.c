/* Effect `damping`: mass-proportional damping of the tissue. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number rate;
} options;

static const app_field fields[] = {
    {"damping", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "motion decays"},
    {"damping.rate", APP_NUMBER, "rate", "20 /s", 0, 1e9, offsetof(options, rate), 0,
     "d in force = -d m v, for materials without their own rate; velocities decay as exp(-d t)"},
};

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    s->damping_1_s = o->rate.si;
    s->def.model.damped = true;
    return 0;
}

const sim_effect sim_effect_damping = {
    .name = "damping",
    .doc = "Viscous damping proportional to mass. Without it the undamped integrator runs, which has fewer "
           "instructions.",
    .example = "{rate: 40 /s}",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .prepare = prepare,
};
