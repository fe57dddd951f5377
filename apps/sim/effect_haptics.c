#include "effects.h"
#include "sim.h"

static const app_field fields[] = {
    {"haptics", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_haptics, here), 0,
     "forces go to a controller: over LCM in real time; in lockstep controller and virtual device run in the same process"},
    {"haptics.extrapolator", APP_CHOICE, "hold|time|position|broyden|tangent|contact|paper_position", "position", 0, 0, offsetof(sim_haptics, extrapolator), 0,
     "in lockstep; in real time the controller says what it runs"},
    {"haptics.rate", APP_NUMBER, "rate", "500 Hz", 50, 10000, offsetof(sim_haptics, rate), 0, "controller ticks a second, in lockstep"},
    {"haptics.passivity", APP_FLAG, NULL, "yes", 0, 0, offsetof(sim_haptics, passivity), 0, "passivity control, in lockstep"},
    {"haptics.latency", APP_NUMBER, "none", "1", 0, 100, offsetof(sim_haptics, latency), 0, "in lockstep: frames between a tool sample and the publishing of its force"},
    {"haptics.jitter", APP_NUMBER, "time", "0 s", 0, 1, offsetof(sim_haptics, jitter), 0, "in lockstep: each sample is late by up to this, at random"},
    {"haptics.loss", APP_NUMBER, "none", "0", 0, 1, offsetof(sim_haptics, loss), 0, "in lockstep: share of force samples lost, at random"},
    {"haptics.seed", APP_INTEGER, NULL, "1", 0, 1e9, offsetof(sim_haptics, seed), 0, "of that randomness; the same seed, the same run"},
};

const sim_effect sim_effect_haptics = {
    .name = "haptics",
    .doc = "Force samples for a 500 Hz controller. Without it instruments follow the `hand` exactly and nobody feels anything.",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_haptics)},
    .needs = {"instruments"},
};
