#include <string.h>

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

static int build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    memcpy(s->gravity_m_s2, o->acceleration.v, sizeof s->gravity_m_s2);
    if (!s->world) return 0;
    return tm_stage_gravity(s->world, o->acceleration.v, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const app_vector *sim_gravity(const sim *s) {
    const options *o = sim_options(s->scene, "gravity");
    return o ? &o->acceleration : NULL;
}

const sim_effect sim_effect_gravity = {
    .name = "gravity",
    .doc = "Weight. Added suddenly at the start; `--settle` gives the shape at rest.",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .build = build,
};
