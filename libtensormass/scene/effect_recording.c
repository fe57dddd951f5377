/* Effect `recording`: writes every message to an LCM log. */
#include "effects.h"
#include "sim.h"

static const app_field fields[] = {
    {"recording", APP_SECTION, NULL, NULL, 0, 0, offsetof(sim_recording, here), 0,
     "every message into a log; lockstep sessions too"},
    {"recording.file", APP_TEXT, NULL, "!", 0, 0, offsetof(sim_recording, file), 0,
     "LCM log to write, relative to where the program runs"},
};

const sim_effect sim_effect_recording = {
    .name = "recording",
    .doc = "A plain LCM log: stock lcm-logplayer, lcm-spy and `tm-evaluate` read it. `--record FILE` names the effect "
           "from outside.",
    .trial = SIM_TRIAL_LEAVE_OUT,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_recording)},
};
