/* Messages of a frame: force samples, status, tissue. The structs of the generated types are filled here for network,
 * log and lockstep. */
#ifndef TM_SIM_PUBLISH_H
#define TM_SIM_PUBLISH_H

#include "app.h"
#include "receive.h"
#include "scene/effects.h"
#include "scene/sim.h"
#include "tools.h"

/* force_sample_t.flags: origin of the reaction (tm_reaction_flag) and events of the frame. */
enum {
    SIM_FLAG_CAPPED = 1,
    SIM_FLAG_OVERFLOWED = 2,
    SIM_FLAG_OVERRAN = 4,
    SIM_FLAG_PATCH = 8,
    SIM_FLAG_UNCONVERGED = 16,
    SIM_FLAG_REPEATED = 32,
    SIM_FLAG_UNSTABLE = 64,
    SIM_FLAG_TOO_FAST = 128,
    SIM_FLAG_INSIDE = 256,
    SIM_FLAG_RELEASING = 512,
    SIM_FLAG_CUTTING = 1024
};

typedef struct sim_publisher {
    app_link *link; /* messages go to this link and into its log; null: no receiver */
    app_link *log;  /* null: none; equals `link` if there is no other link */
    bool forces;    /* force samples are published */
    sim_ears ears;
    int64_t session;
    int32_t seq[TM_MAX_INSTRUMENTS], status_seq, tissue_seq, cut_seq;
    int64_t dropped_us;
    const sim_rendering *rendering; /* null: no tissue */
    int32_t *removed;               /* [tet_count] of a CUT message; null without `cut` */
    tensormass_contact_patch_t patch;
} sim_publisher;

/* Routes of messages. */
typedef struct sim_way {
    const char *url;  /* URL of the network; null: none */
    app_queue *queue; /* queue within this process; null: none */
    const char *log;  /* null: none */
    const app_key *key;
    int64_t session;
    bool forces;
    sim_listener listener; /* tool null: nothing is received */
} sim_way;

/* Numbers of discarded messages. */
typedef struct sim_refused {
    int64_t malformed; /* malformed messages */
    int64_t forged;    /* messages with a wrong tag, replayed ones, and answers to another simulation */
    int64_t packets;   /* packets that are not LCM or are too long */
    int64_t foreign;   /* packets of other machines, although the URL has ttl=0 */
} sim_refused;

/* Opens the publisher. Returns 0 or an exit code. It must not move while it is open. */
int sim_publisher_open(sim_publisher *p, const sim *s, const sim_way *way);
/* Returns false if the log could not be completed. */
bool sim_publisher_close(sim_publisher *p);
sim_refused sim_publisher_refused(const sim_publisher *p);

/* Fills the force sample of an instrument after a frame. tool_session is 0 before the first controller message. Values
 * that are not finite are sent as zero force and stiffness, flagged unstable. */
void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session,
                      int64_t tool_utime, int32_t flags, tensormass_force_sample_t *out);
/* Fills the patch of the last frame with its sample's seq. Send it before the sample. Returns false if there is
 * none. */
bool sim_contact_patch(const sim_publisher *p, const sim *s, const tensormass_force_sample_t *sample,
                       tensormass_contact_patch_t *out);
/* Publishes patch and sample of an instrument, after a frame of `substeps` substeps; the force is averaged over the
 * last `average`. */
void sim_publish_reaction(sim_publisher *p, const sim *s, sim_tools *tools, int instrument, int64_t utime,
                          int32_t substeps, int32_t average, int32_t flags, tensormass_force_sample_t *sample);
/* Publishes cuts, status and tissue. compute_s: time spent on the frame; rate_Hz: rate of force samples. */
void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed, double rate_Hz);

#endif
