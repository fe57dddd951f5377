/* What a frame tells the world: force samples, status, tissue. Structs of the generated types, filled here for network,
 * log and lockstep alike. */
#ifndef TM_SIM_PUBLISH_H
#define TM_SIM_PUBLISH_H

#include "app.h"
#include "receive.h"
#include "scene/effects.h"
#include "scene/sim.h"
#include "tools.h"

/* force_sample_t.flags: how the reaction came about (tm_reaction_flag), and what befell the frame. */
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
    app_link *link; /* to whom it goes, and into the log; null: nobody listens */
    app_link *log;  /* null: none; `link` itself where there is nothing else */
    bool forces;    /* force samples are published */
    sim_ears ears;
    int64_t session;
    int32_t seq[TM_MAX_INSTRUMENTS], status_seq, tissue_seq, cut_seq;
    int64_t dropped_us;
    const sim_rendering *rendering; /* null: no tissue */
    int32_t *removed;               /* [tet_count] of a CUT message; null without `cut` */
    tensormass_contact_patch_t patch;
} sim_publisher;

/* Which way messages go. */
typedef struct sim_way {
    const char *url;  /* the network; null: not there */
    app_queue *queue; /* this process; null: not there */
    const char *log;  /* null: none */
    const app_key *key;
    int64_t session;
    bool forces;
    sim_listener listener; /* tool null: nobody is listened to */
} sim_way;

/* What was thrown away of what came. */
typedef struct sim_refused {
    int64_t malformed; /* messages that are not whole */
    int64_t forged;    /* without the key's tag, heard before, or an answer to another simulation */
    int64_t packets;   /* not LCM's, or too long */
    int64_t foreign;   /* of other machines, though the URL has ttl=0 */
} sim_refused;

/* 0 or an exit code. The publisher stays where it is while it is open. */
int sim_publisher_open(sim_publisher *p, const sim *s, const sim_way *way);
/* False: the log could not be written to its end. */
bool sim_publisher_close(sim_publisher *p);
sim_refused sim_publisher_refused(const sim_publisher *p);

/* The force sample of an instrument after a frame. tool_session 0: no controller has spoken. What is not finite is sent
 * as no force and no stiffness, flagged unstable. */
void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session,
                      int64_t tool_utime, int32_t flags, tensormass_force_sample_t *out);
/* The patch of the last frame, with its sample's seq; before the sample. False: there is none. */
bool sim_contact_patch(const sim_publisher *p, const sim *s, const tensormass_force_sample_t *sample,
                       tensormass_contact_patch_t *out);
/* Both of an instrument, after a frame of so many substeps of which the last `average` were averaged. */
void sim_publish_reaction(sim_publisher *p, const sim *s, sim_tools *tools, int instrument, int64_t utime,
                          int32_t substeps, int32_t average, int32_t flags, tensormass_force_sample_t *sample);
/* Cuts, status, tissue. compute_s: spent on the frame; rate_Hz: of force samples. */
void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed, double rate_Hz);

#endif
