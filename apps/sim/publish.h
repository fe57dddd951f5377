/* What a frame tells the world: force samples, status, tissue. Structs of the generated types, filled here for network,
 * log and lockstep alike. */
#ifndef TM_SIM_PUBLISH_H
#define TM_SIM_PUBLISH_H

#include "effects.h"
#include "lcm_link.h"
#include "sim.h"

/* force_sample_t.flags: how the reaction came about (tm_reaction_flag), and what befell the frame. */
enum {
    SIM_FLAG_CAPPED = 1,
    SIM_FLAG_OVERFLOWED = 2,
    SIM_FLAG_OVERRAN = 4,
    SIM_FLAG_PATCH = 8,
    SIM_FLAG_UNCONVERGED = 16,
    SIM_FLAG_HELD_OVER = 32,
    SIM_FLAG_UNSTABLE = 64,
    SIM_FLAG_TOO_FAST = 128,
    SIM_FLAG_INSIDE = 256,
    SIM_FLAG_LETTING_GO = 512
};

typedef struct sim_publisher {
    const sim_lcm_api *api; /* null: nobody listens */
    sim_lcm *link;
    int64_t session;
    int32_t seq[TM_MAX_INSTRUMENTS], status_seq, tissue_seq, cut_seq;
    int64_t dropped_us;
    const sim_rendering *rendering; /* null: no tissue */
    int32_t *removed;               /* [tet_count] of a CUT message; null without `cut` */
} sim_publisher;

/* Opens the module `lcm` when `url` (network) or a log asks for it. 0 or an exit code. */
int sim_publisher_open(sim_publisher *p, const sim *s, const char *url, const char *log, const app_key *key,
                       int64_t session);
bool sim_publisher_close(sim_publisher *p);

/* The tissue as it is now; the surface's arrays are rewritten by the next call. Scenes with `rendering` only. */
const tensormass_tissue_t *sim_picture_now(sim *s, int64_t utime, int64_t session, int32_t seq);

/* The force sample of an instrument after a frame. tool_session 0: no controller has spoken. What is not finite is sent
 * as no force and no stiffness, flagged unstable. */
void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session,
                      int64_t tool_utime, int32_t flags, tensormass_force_sample_t *out);
/* The patch of the last frame, with its sample's seq; before the sample. False: there is none. */
bool sim_contact_patch(const sim_publisher *p, const sim *s, const tensormass_force_sample_t *sample,
                       tensormass_contact_patch_t *out);
void sim_publish_patch(sim_publisher *p, int64_t utime, const tensormass_contact_patch_t *patch);
void sim_publish_force(sim_publisher *p, int64_t utime, const tensormass_force_sample_t *sample);
/* Cuts, status, tissue. compute_s: spent on the frame. */
void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed);

#endif
