/* Energy: an account of what goes into the tissue of a world and what comes out, kept step by step in the terms of the
 * integrator itself, so that it closes to rounding (docs/time-stepping.md, "Energy"). A stage of its own: a world
 * without it pays nothing; with it, two passes over the vertices a step and 48 bytes a vertex. */
#ifndef TENSORMASS_ENERGY_H
#define TENSORMASS_ENERGY_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Joules; since the stage was added where not said otherwise. With u, v of the tissue with mass:
 *   start + contact + grasp + support + gravity + load + moved - damping - cut = kinetic + elastic + residual. */
typedef struct tm_energy {
    double time_s; /* to which the account goes: the middle of the last step */
    /* stored now */
    double kinetic_J; /* v.Mv/2, v = (u - u_prev)/dt, which belongs to that middle */
    double elastic_J; /* u_prev.K u/2: of the two ends of the last step, as the scheme conserves it */
    double start_J;   /* both when the account began */
    /* work done on the tissue; negative: the tissue did it */
    double contact_J[TM_MAX_INSTRUMENTS]; /* by the rows of each instrument and their film */
    double grasp_J[TM_MAX_INSTRUMENTS];   /* by the springs of its jaws */
    double support_J;                     /* by supports; at rest they do none */
    double gravity_J;
    double load_J;         /* by all other stages that add to force_N; what viscosity gave (taken: negative) */
    double state_change_J; /* by what is no motion: a new step, a settled or restored or overwritten state; else
                              rounding */
    /* taken from it */
    double damping_J;  /* never negative; of a hybrid what its condensed part, which has no waves, does not give back */
    double cut_J;      /* what removed tetrahedra held, moving and strained */
    double residual_J; /* what none of these explains: rounding (with the stage "rotation" what the last step made of
                          energy, which the next takes back), unless a stage moves u_next_m that the account
                          does not know */
    /* between hand and tissue */
    double tool_work_J[TM_MAX_INSTRUMENTS]; /* work that moving the instrument put into contact and grasp */
    double drag_J;                          /* lost to the film between tool and tissue, never negative */
    double friction_J;                      /* lost to slip against friction, never negative */
    double contact_stored_J; /* held now in skins (pressed, and stretched by friction) and in the springs of jaws */
    /* contact + grasp + film + friction + sprung - hand: above zero contact made energy out of nothing, below it lost
     * some (springs are solved implicitly, what the jaws let go slips). A tool placed into tissue pushes it out: that
     * is above. */
    double generated_J;
} tm_energy;

/* Adds the stage "energy". What other stages the world has, and gets later, it finds by itself. */
TM_API tm_status tm_stage_energy(tm_world *world, tm_error *error);
/* The account up to the last step. TM_ERR_ARGUMENT: the world has no stage "energy". */
TM_API tm_status tm_world_energy(const tm_world *world, tm_energy *energy, tm_error *error);

/* Tissue beside the world's own: of a hybrid its condensed part, which has no mass and is in balance with its border
 * and with what presses on it in every step. Vertices without mass are its; what rows do to them it says itself. */
typedef struct tm_part_energy {
    double before_J, stored_J; /* at the middle of the last step and of this one, as the scheme conserves it */
    double outer_J;            /* work of its elastic force on the world's vertices: in load_J but for this */
    double contact_J[TM_MAX_INSTRUMENTS]; /* done by rows on its vertices, and through them on its border */
    double lost_J, eased_J;               /* lost in this step; between the last one and this */
} tm_part_energy;
typedef struct tm_energy_part {
    void *self;
    /* Of the step just made: u_prev_m, u_m and u_next_m are still its. Called once a step in a world that keeps an
     * account. */
    void (*work)(void *self, tm_world *world, tm_part_energy *energy);
} tm_energy_part;
/* `part` must outlive its place in the world; null: none (a world begins so). */
TM_API void tm_world_set_energy_part(tm_world *world, const tm_energy_part *part);

#ifdef __cplusplus
}
#endif
#endif
