/* Every effect that a scene can name: one row each. Its fields, checks and stages are in effect_NAME.c. */
#include "sim.h"

extern const sim_effect sim_effect_anisotropy, sim_effect_damping, sim_effect_gravity, sim_effect_breathing,
    sim_effect_contact, sim_effect_grasp, sim_effect_cut, sim_effect_precomputed, sim_effect_hybrid, sim_effect_haptics,
    sim_effect_recording, sim_effect_rendering, sim_effect_energy;

/* The order in which they are prepared and built, and so the order of their stages within a phase. */
const sim_effect *const sim_effects[] = {
    &sim_effect_anisotropy, &sim_effect_damping,     &sim_effect_gravity,   &sim_effect_breathing,
    &sim_effect_contact,    &sim_effect_grasp, /* after contact: both share its sweeps */
    &sim_effect_cut,        &sim_effect_precomputed, &sim_effect_hybrid,    &sim_effect_energy,
    &sim_effect_haptics,    &sim_effect_recording,   &sim_effect_rendering,
};

const int sim_effect_count = sizeof sim_effects / sizeof sim_effects[0];
