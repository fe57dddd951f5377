/* What graspers hold: shared by grasp.c, grasp_springs.c and grasp_snapshot.c. */
#ifndef TM_GRASP_INTERNAL_H
#define TM_GRASP_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/grasp.h"

/* Where a jaw is: its frame and the tip. */
typedef struct tm_jaw_place {
    double axis_m[3][3], tip_m[3];
} tm_jaw_place;

typedef struct grasp_of_jaw {
    tm_grasp_state state;
    bool was_closed;
    int32_t placings; /* of the tool, as last seen */
    tm_jaw jaw;       /* frame at this substep */
    bool seen;        /* contact has looked at what is being let go */
    double fade;      /* of what the springs can bear while releasing, 1 to 0 */
    int32_t count;
    int32_t *vertex;    /* [max_vertices] */
    double *offset_m;   /* [3*max_vertices] where the jaw has it, in the tool's frame */
    double *target_m;   /* [3*max_vertices] the same in the world, now */
    double *force_N;    /* [3*max_vertices] on the tissue */
    double *let_go_N;   /* [3*max_vertices] the same when the jaw opened */
    double *distance_m; /* [max_vertices] scratch of the capture */
    /* While releasing, of each station of the tool: how deep what it lets go lies in it. That is forgiven: it may not
     * go deeper, and as it gets out, less is. */
    double embedded_m[TM_MAX_STATIONS];
    /* for what the springs make: where the jaw is, and was at the ends of the last two substeps; what they held then */
    tm_jaw_place place[3];
    double contact_stored_J[2];
} grasp_of_jaw;

struct tm_grasp {
    tm_pool pool;
    tm_grasp_def def;
    tm_contact *contact;
    grasp_of_jaw grasp[TM_MAX_INSTRUMENTS], saved[TM_MAX_INSTRUMENTS]; /* kept: when the step began */
};

void tm_hold_vertex_at(const tm_world *world, const double *u_m, int32_t vertex, double at_m[3]);

/* grasp_springs.c */
/* Put somewhere at once. */
void tm_hold_place(grasp_of_jaw *h, const tm_tool *tool);
/* A substep begins: what could not be borne in the last one slips, before the jaw turns. */
void tm_hold_begin(const tm_grasp *grasp, grasp_of_jaw *h, const tm_world *world);
void tm_hold_follow(grasp_of_jaw *h, const tm_tool *tool); /* it has turned */
/* It has just closed, upon what contact bore: with the forces go what their skins held. */
void tm_hold_take_over(tm_grasp *grasp, grasp_of_jaw *h, int32_t t);
/* One spring starts from the last substep's force. */
void tm_hold_start(const tm_grasp *grasp, grasp_of_jaw *h, int32_t i, tm_world *world);
/* The block's hooks. */
void tm_grasp_sweep(void *self, tm_world *world, int32_t number);
void tm_grasp_finish(void *self, tm_world *world);
bool tm_grasp_push(void *self, tm_world *world, int32_t vertex, const double force_N[3]);
bool tm_grasp_hold_back(void *self, tm_world *world, int32_t t);
double tm_grasp_lost(void *self, const tm_world *world, int32_t t);

/* The stage's hooks. */
int64_t tm_grasp_snapshot(void *self, void *buffer);
int64_t tm_grasp_snapshot_max(const tm_grasp *grasp);
bool tm_grasp_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
void tm_grasp_checkpoint(void *self);
void tm_grasp_rollback(void *self, tm_world *world);

#endif
