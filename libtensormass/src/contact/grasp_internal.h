/* State of grasps, shared by grasp.c, grasp_springs.c and grasp_snapshot.c. */
#ifndef TM_GRASP_INTERNAL_H
#define TM_GRASP_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/grasp.h"

/* Position of a jaw: its frame and the tip. */
typedef struct tm_jaw_place {
    double axis_m[3][3], tip_m[3];
} tm_jaw_place;

typedef struct grasp_of_jaw {
    tm_grasp_state state;
    bool was_closed;
    int32_t placings; /* of the tool, at the last substep */
    tm_jaw jaw;       /* frame at this substep */
    bool seen;        /* contact has checked the released vertices */
    double fade;      /* force limit of the springs while releasing, relative, 1 to 0 */
    int32_t count;
    int32_t *vertex;    /* [max_vertices] */
    double *offset_m;   /* [3*max_vertices] position in the tool's frame, fixed to the jaw */
    double *target_m;   /* [3*max_vertices] the same in world coordinates, now */
    double *force_N;    /* [3*max_vertices] on the tissue */
    double *let_go_N;   /* [3*max_vertices] force when the jaw opened */
    double *distance_m; /* [max_vertices] scratch memory of the capture */
    /* Depth of each station of the tool in released tissue. That depth is tolerated: it may not increase, and is
     * reduced as the tissue comes free. */
    double embedded_m[TM_MAX_STATIONS];
    /* for the energy of the springs: position of the jaw now and at the ends of the last two substeps; energy stored
     * then */
    tm_jaw_place place[3];
    double contact_stored_J[2];
} grasp_of_jaw;

struct tm_grasp {
    tm_pool pool;
    tm_grasp_def def;
    tm_contact *contact;
    grasp_of_jaw grasp[TM_MAX_INSTRUMENTS], saved[TM_MAX_INSTRUMENTS]; /* saved: at the start of the step */
};

void tm_hold_vertex_at(const tm_world *world, const double *u_m, int32_t vertex, double at_m[3]);

/* grasp_springs.c */
/* Handles a teleport of the tool. */
void tm_hold_place(grasp_of_jaw *h, const tm_tool *tool);
/* Begins a substep: force beyond the limits of the last one slips, before the jaw rotates. */
void tm_hold_begin(const tm_grasp *grasp, grasp_of_jaw *h, const tm_world *world);
void tm_hold_follow(grasp_of_jaw *h, const tm_tool *tool); /* after rotation */
/* Takes over the contact forces of a jaw that has just closed. Where its springs would store more than the rows'
 * compliance did, `stored_J`, and than contact may generate, all are reduced by one share. */
void tm_hold_take_over(tm_grasp *grasp, grasp_of_jaw *h, int32_t t, double stored_J);
/* Starts one spring from the force of the last substep. */
void tm_hold_start(const tm_grasp *grasp, grasp_of_jaw *h, int32_t i, tm_world *world);
/* Hooks of the block. */
void tm_grasp_sweep(void *self, tm_world *world, int32_t number);
void tm_grasp_finish(void *self, tm_world *world);
bool tm_grasp_push(void *self, tm_world *world, int32_t vertex, const double force_N[3]);
bool tm_grasp_hold_back(void *self, tm_world *world, int32_t t);
double tm_grasp_lost(void *self, const tm_world *world, int32_t t);

/* Hooks of the stage. */
int64_t tm_grasp_snapshot(void *self, void *buffer);
int64_t tm_grasp_snapshot_max(const tm_grasp *grasp);
bool tm_grasp_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
void tm_grasp_checkpoint(void *self);
void tm_grasp_rollback(void *self, tm_world *world);

#endif
