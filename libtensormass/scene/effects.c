/* Every effect that a scene can name: one row each, effect_NAME.c. Its fields, checks and stages are there. */
#include "sim.h"

/* The order in which they are prepared and built, and so the order of their stages within a phase: grasp after contact,
 * whose sweeps it shares. */
#define EFFECTS(ROW)                                                                                                   \
    ROW(anisotropy)                                                                                                    \
    ROW(strain_smoothing)                                                                                              \
    ROW(damping)                                                                                                       \
    ROW(gravity)                                                                                                       \
    ROW(breathing)                                                                                                     \
    ROW(rotation)                                                                                                      \
    ROW(viscosity)                                                                                                     \
    ROW(contact)                                                                                                       \
    ROW(grasp)                                                                                                         \
    ROW(friction)                                                                                                      \
    ROW(cut)                                                                                                           \
    ROW(precomputed)                                                                                                   \
    ROW(hybrid)                                                                                                        \
    ROW(energy)                                                                                                        \
    ROW(haptics)                                                                                                       \
    ROW(recording)                                                                                                     \
    ROW(rendering)

#define DECLARED(name) extern const sim_effect sim_effect_##name;
EFFECTS(DECLARED)

#define LISTED(name) &sim_effect_##name,
const sim_effect *const sim_effects[] = {EFFECTS(LISTED)};

const int sim_effect_count = sizeof sim_effects / sizeof sim_effects[0];
