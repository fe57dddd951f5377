/* Corotational correction for tissue that rotates and bends far. Tetrahedra whose displacement gradient exceeds a
 * threshold get the difference between the corotational and the linear law, added to the tensors (docs/corotation.md).
 * A separate stage: a world without it has no cost. */
#ifndef TENSORMASS_ROTATION_H
#define TENSORMASS_ROTATION_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Default of tm_tissue_def.rotation: the threshold, as Frobenius norm of the displacement gradient (1 is a strain of 1,
 * or a rotation by 41 degrees). The correction is complete at TM_ROTATION_BAND times the threshold. In between it grows
 * smoothly, so that neither force nor stiffness jumps. */
#define TM_ROTATION_THRESHOLD 0.02
#define TM_ROTATION_THRESHOLD_MIN 1e-3
#define TM_ROTATION_THRESHOLD_MAX 0.1
#define TM_ROTATION_BAND 3

typedef struct tm_rotation tm_rotation;

/* Adds the stage "rotation" after "force". The tissue must be built with tm_tissue_def.rotation > 0, so that its
 * guaranteed step holds when it rotates. If it is in TM_SINGLE, steps compute the correction in single precision. The
 * world owns the handle; `rotation` may be null. The stage keeps the energy that steps generated and that could not be
 * removed at once (docs/corotation.md, "Energy of the step"), in snapshots too: mostly 0. */
TM_API tm_status tm_stage_rotation(tm_world *world, tm_rotation **rotation, tm_error *error);

typedef struct tm_rotation_report {
    int32_t batches; /* of TM_ROTATION_LANES tetrahedra each, computed together */
    int32_t checked; /* batches whose gradients were computed in the last step */
    int32_t active;  /* of these, batches with a tetrahedron beyond the threshold */
} tm_rotation_report;
#define TM_ROTATION_LANES 8
TM_API tm_rotation_report tm_rotation_last(const tm_rotation *rotation);

/* Returns the energy of the correction at u [3*vertex_count] m, J. Added to tm_tissue_energy it is the stored
 * energy. */
TM_API double tm_rotation_energy(const tm_rotation *rotation, const double *u_m);
/* Computes the force of the correction, N. force_N [3*vertex_count] is overwritten; added to tm_tissue_force it is the
 * tissue's force. */
TM_API void tm_rotation_force(const tm_rotation *rotation, const double *u_m, double *force_N);

/* Returns the `rotation` of the definition. */
TM_API double tm_tissue_rotation(const tm_tissue *tissue);
/* Replaces the tensors of a tissue that is not stepped by the corotated ones R K R^T. R is the rotation of each
 * tetrahedron at u_m [3*vertex_count] m. That is the tangent of the law without the stress term: positive semidefinite
 * at every u, and exact at small strain. `threshold`: as tm_tissue_def.rotation. TM_DOUBLE only. With averaged shear
 * (smoothed_shear_share above 0): TM_ERR_ARGUMENT. Allocates while it runs. */
TM_API tm_status tm_tissue_corotate(tm_tissue *tissue, double threshold, const double *u_m, tm_error *error);

/* Replaces the tensors of a tissue that is not stepped by the tangent of a nonlinear law at u_m [3*vertex_count] m.
 * `whole`: a tissue of the same mesh that has the law; `tissue` has the linear one, TM_DOUBLE. `definite`: of each
 * tetrahedron only the positive semidefinite part. Allocates while it runs. */
TM_API tm_status tm_tissue_take_tangent(tm_tissue *tissue, const tm_tissue *whole, const double *u_m, bool definite,
                                        tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
