/* Where the instruments are said to be: newest trustworthy tool_state of each, and the path of the coming frame.
 * Messages come from a network and are not trusted. */
#ifndef TM_SIM_TOOLS_H
#define TM_SIM_TOOLS_H

#include "core/gate.h"
#include "lcm_types/tensormass_tool_state_t.h"
#include "scene/sim.h"

typedef struct sim_tool {
    tensormass_tool_state_t now; /* newest accepted */
    bool seen, used_seen;
    int64_t used_utime, used_session;          /* of the sample that the last frame ended at */
    int64_t accepted, late, foreign, rejected; /* foreign: another session or instrument */
    hrt_gate gate;                             /* whose word is taken */
} sim_tool;

typedef struct sim_tools {
    const sim *s;
    sim_tool tool[TM_MAX_INSTRUMENTS];
} sim_tools;

/* Null if it was taken, else a sentence why not. now_us: this side's monotonic clock. */
const char *sim_tools_take(sim_tools *t, int instrument, int64_t now_us, const tensormass_tool_state_t *message);
/* Where a frame that begins now shall end; the instrument stays where it is when nothing came. */
tm_tool_pose sim_tools_target(const sim_tools *t, int instrument);
/* What the controller's extrapolator needs, as far as the scene lets it. */
sim_sends sim_tools_want(const sim_tools *t, int instrument);
/* The controller's time of the frame's average, once the frame is done. 0: no controller yet, or a frame that brought
 * the tool to a new one. */
int64_t sim_tools_mean_utime(sim_tools *t, int instrument, int32_t substeps, int32_t average);

#endif
