/* All effects that a scene can name: one row each, effect_NAME.c with its fields, checks and stages. */
#include "sim.h"

/* The order in which effects are prepared and built, and so of their stages within a phase. Grasp follows contact,
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
    ROW(touch)                                                                                                         \
    ROW(ties)                                                                                                          \
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
