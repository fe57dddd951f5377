#include "effects.h"
#include "sim.h"

static const app_field fields[] = {
    {"rendering", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_rendering, here), 0, "the surface goes out for pictures, on TISSUE"},
    {"rendering.every", APP_INTEGER, NULL, "1", 1, 10000, offsetof(sim_rendering, every), 0, "one in so many frames"},
};

const sim_effect sim_effect_rendering = {
    .name = "rendering",
    .doc = "`tissue` messages for tm-view, live or in the recording. The simulation itself opens no graphics library.",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_rendering)},
};
