/* What a frame tells the world: force samples, status, tissue. Structs of the generated types, filled here for network, log and lockstep alike. */
#ifndef TM_SIM_PUBLISH_H
#define TM_SIM_PUBLISH_H

#include "effects.h"
#include "lcm_link.h"
#include "sim.h"

enum { SIM_FLAG_CAPPED = 1, SIM_FLAG_OVERFLOWED = 2, SIM_FLAG_OVERRAN = 4, SIM_FLAG_PATCH = 8 };

typedef struct sim_publisher {
    const sim_lcm_api *api; /* null: nobody listens */
    sim_lcm *link;
    int64_t session;
    int32_t seq[TM_MAX_INSTRUMENTS], status_seq, tissue_seq;
    int64_t dropped_us;
    const sim_rendering *rendering; /* null: no tissue */
    tensormass_tissue_t tissue;
    int32_t *slot_of;      /* [vertex_count] index into the message, -1: not on the surface */
    int32_t tissue_revision;
    int64_t tissue_capacity_vertices, tissue_capacity_triangles;
} sim_publisher;

/* Opens the module `lcm` when `url` (network) or a log asks for it. 0 or an exit code. */
int sim_publisher_open(sim_publisher *p, const sim *s, const char *url, const char *log, int64_t session);
bool sim_publisher_close(sim_publisher *p);

/* The force sample of an instrument after a frame. tool_session 0: no controller has spoken. `stiffness`: the controller's extrapolator wants it. */
void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session, int64_t tool_utime, bool stiffness,
                      int32_t flags, tensormass_force_sample_t *out);
void sim_publish_force(sim_publisher *p, int64_t utime, const tensormass_force_sample_t *sample);
/* Status, tissue. compute_s: spent on the frame. */
void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed);

#endif
