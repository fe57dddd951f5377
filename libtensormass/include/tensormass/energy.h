/* Energy account of the tissue of a world. It uses the integrator's own terms in each step, so that it closes to
 * rounding (docs/energy.md). A separate stage: a world without it has no cost. With it, a step costs two passes over
 * the vertices, and a vertex 51 bytes; with rotation or a nonlinear law also its force and energy once, and 144 bytes.
 * Add it after these, else they are computed three times a step. */
#ifndef TENSORMASS_ENERGY_H
#define TENSORMASS_ENERGY_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Energy account, J, summed since the stage was added unless said otherwise. With u, v of the tissue with mass:
 *   start + contact + grasp + touch + support + gravity + load + state_change - damping - cut = kinetic + elastic +
 * residual. */
typedef struct tm_energy {
    double time_s; /* end of the account: the middle of the last step */
    /* stored now */
    double kinetic_J; /* v.Mv/2, v = (u - u_prev)/dt, at time_s */
    double elastic_J; /* u_prev.K u/2, from both ends of the last step: the scheme conserves this form */
    double start_J;   /* kinetic + elastic when the account began */
    /* work done on the tissue; negative: done by the tissue */
    double contact_J[TM_MAX_INSTRUMENTS]; /* by the rows of each instrument, drag included */
    double grasp_J[TM_MAX_INSTRUMENTS];   /* by the grasp springs */
    double support_J;                     /* by supports; 0 if they do not move */
    double gravity_J;
    double load_J;         /* by all other stages that add to force_N, viscosity included (negative: dissipated) */
    double state_change_J; /* change of state without motion: a new step size, a settled, restored or overwritten state;
                              else rounding */
    /* removed from the tissue */
    double damping_J; /* never negative; with a hybrid also what its massless condensed part dissipates */
    double cut_J;     /* kinetic and elastic energy of removed tetrahedra */
    /* Energy that no other term explains: rounding, unless a stage unknown to the account changes u_next_m. With the
     * stage "rotation" it also holds the energy that the last step generated and the next one removes. */
    double residual_J;
    /* between hand and tissue */
    double tool_work_J[TM_MAX_INSTRUMENTS]; /* work that tool motion did on contact and grasp */
    double drag_J;                          /* dissipated by viscous contact drag, never negative */
    double friction_J;                      /* dissipated by friction, never negative */
    double contact_stored_J; /* stored now in contact compliance (normal and tangential) and grasp springs */
    /* contact + grasp + drag + friction + contact_stored - tool_work. Above zero, contact generated energy; below, it
     * lost some (springs are solved implicitly; released tissue slips). A tool placed inside tissue pushes it out: that
     * counts as generated. */
    double generated_J;
    /* Stages "touch" and "ties": work of their forces on the tissue, and energy stored now in compliance and springs.
     * Below zero, their sum is what friction, drag, impacts and ties that went dissipated; above zero, they generated
     * energy. */
    double touch_J, touch_stored_J;
} tm_energy;

/* Adds the stage "energy". It finds the world's other stages by itself, later ones included. */
TM_API tm_status tm_stage_energy(tm_world *world, tm_error *error);
/* Returns the account up to the last step. TM_ERR_ARGUMENT: the world has no stage "energy". */
TM_API tm_status tm_world_energy(const tm_world *world, tm_energy *energy, tm_error *error);

/* Energy of tissue outside the world's own: the condensed part of a hybrid. It has no mass and is in equilibrium with
 * its interface and its contact forces in every step. Vertices without mass belong to it; it reports the work of rows
 * on them. */
typedef struct tm_part_energy {
    /* Stored energy at the middles of the previous and this step, in the form that the scheme conserves. */
    double before_J, stored_J;
    double outer_J;                       /* work of its elastic force on the world's vertices; not counted in load_J */
    double contact_J[TM_MAX_INSTRUMENTS]; /* by rows on its vertices, and through them on its interface */
    double lost_J, eased_J;               /* dissipated in this step; between the previous step and this one */
} tm_part_energy;
typedef struct tm_energy_part {
    void *self;
    /* Reports the step just made; u_prev_m, u_m and u_next_m are still those of that step. Called once a step in a
     * world that has an account. */
    void (*work)(void *self, tm_world *world, tm_part_energy *energy);
} tm_energy_part;
/* Sets the additional part; null: none (the initial state). `part` must outlive its use by the world. */
TM_API void tm_world_set_energy_part(tm_world *world, const tm_energy_part *part);

#ifdef __cplusplus
}
#endif
#endif
