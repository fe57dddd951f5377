/* What graspers hold: shared by grasp.c and grasp_snapshot.c. */
#ifndef TM_GRASP_HOLD_H
#define TM_GRASP_HOLD_H

#include "contact/contact_internal.h"
#include "tensormass/grasp.h"

typedef struct hold {
    tm_grasp_state state;
    bool was_closed;
    int32_t placings; /* of the tool, as last seen */
    tm_jaw jaw;       /* frame at this substep */
    bool seen;        /* contact has looked at what is being let go */
    double fade;      /* of what the springs can bear while letting go, 1 to 0 */
    int32_t count;
    int32_t *vertex;    /* [max_vertices] */
    double *offset_m;   /* [3*max_vertices] where the jaw has it, in the tool's frame */
    double *target_m;   /* [3*max_vertices] the same in the world, now */
    double *force_N;    /* [3*max_vertices] on the tissue */
    double *let_go_N;   /* [3*max_vertices] the same when the jaw opened */
    double *distance_m; /* [max_vertices] scratch of the capture */
    bool *slips;        /* [max_vertices] scratch of a substep: its spring bears all that it can */
    /* While letting go, of each station of the tool: how deep what it lets go lies in it. That is forgiven: it may not
     * go deeper, and as it gets out, less is. */
    double embedded_m[TM_MAX_STATIONS];
} hold;

struct tm_grasp {
    tm_pool pool;
    tm_grasp_def def;
    tm_contact *contact;
    hold hold[TM_MAX_INSTRUMENTS], kept[TM_MAX_INSTRUMENTS]; /* kept: when the step began */
};

/* The stage's hooks. */
int64_t tm_grasp_snapshot(void *self, void *buffer);
int64_t tm_grasp_snapshot_max(const tm_grasp *grasp);
bool tm_grasp_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
void tm_grasp_keep(void *self);
void tm_grasp_give_back(void *self, tm_world *world);

#endif
