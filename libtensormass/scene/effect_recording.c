/* Effect `recording`: writes every message to an LCM log. */
#include "effects.h"
#include "sim.h"

static const app_field fields[] = {
    {"recording", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_recording, here), 0,
     "record every message in a log, also in lockstep"},
    {"recording.file", APP_TEXT, NULL, "!", 0, 0, offsetof(sim_recording, file), 0,
     "LCM log to write, relative to the working folder"},
};

const sim_effect sim_effect_recording = {
    .name = "recording",
    .doc = "A standard LCM log: lcm-logplayer, lcm-spy and `tm-evaluate` read it. `--record FILE` adds this "
           "effect on the command line.",
    .trial = SIM_TRIAL_LEAVE_OUT,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_recording)},
};
