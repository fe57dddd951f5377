/* Poses of the instruments: the newest valid tool_state of each, and the target of the next frame. Messages come from a
 * network and are not trusted. */
#ifndef TM_SIM_TOOLS_H
#define TM_SIM_TOOLS_H

#include "core/gate.h"
#include "lcm_types/tensormass_tool_state_t.h"
#include "scene/sim.h"

typedef struct sim_tool {
    tensormass_tool_state_t now; /* newest accepted */
    bool seen, used_seen;
    int64_t used_utime, used_session;          /* times of the sample at which the last frame ended */
    int64_t accepted, late, foreign, rejected; /* foreign: another session or instrument */
    hrt_gate gate;                             /* selects the accepted sender */
} sim_tool;

typedef struct sim_tools {
    const sim *s;
    sim_tool tool[TM_MAX_INSTRUMENTS];
} sim_tools;

/* Returns null if the message was accepted, else a sentence with the reason. now_us: this side's monotonic clock. */
const char *sim_tools_take(sim_tools *t, int instrument, int64_t now_us, const tensormass_tool_state_t *message);
/* Returns the pose at the end of a frame that begins now. Without a new message the instrument does not move. */
tm_tool_pose sim_tools_target(const sim_tools *t, int instrument);
/* Returns the contents that the controller's extrapolator needs, within the scene's settings. */
sim_sends sim_tools_want(const sim_tools *t, int instrument);
/* Returns the controller's time of the frame's average, after the frame. Returns 0 without a controller, or if a new
 * one took over during the frame. */
int64_t sim_tools_mean_utime(sim_tools *t, int instrument, int32_t substeps, int32_t average);

#endif
