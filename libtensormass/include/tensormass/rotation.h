/* Rotation: tissue that turns and bends far, and keeps its law. Tetrahedra whose displacement gradient passes a
 * threshold get the difference between the corotational law and the linear one on top of the tensors
 * (docs/corotation.md). A stage of its own: a world without it pays nothing. */
#ifndef TENSORMASS_ROTATION_H
#define TENSORMASS_ROTATION_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of tm_tissue_def.rotation: where the correction begins, as the Frobenius norm of the displacement gradient (1 is a
 * strain of 1, or a turn by 41 degrees). It is whole at TM_ROTATION_BAND times that; between the two it grows smoothly,
 * so that neither force nor stiffness jumps. */
#define TM_ROTATION_THRESHOLD 0.02
#define TM_ROTATION_THRESHOLD_MIN 1e-3
#define TM_ROTATION_THRESHOLD_MAX 0.1
#define TM_ROTATION_BAND 3

typedef struct tm_rotation tm_rotation;

/* Adds the stage "rotation", after "force", to a world whose tissue was made with tm_tissue_def.rotation > 0 (so that
 * its guaranteed step holds for tissue that turns) and in TM_DOUBLE. The world owns the handle, which may be asked for
 * (rotation null: not). Of steps before it keeps energy that they made and that could not be
 * taken back at once (docs/corotation.md, "Energy of the step"), in snapshots too: mostly 0. */
TM_API tm_status tm_stage_rotation(tm_world *world, tm_rotation **rotation, tm_error *error);

typedef struct tm_rotation_report {
    int32_t batches; /* of TM_ROTATION_LANES tetrahedra each: what is computed at a time */
    int32_t checked; /* at the last step: packs whose gradients were computed */
    int32_t active;  /* of these, packs with a tetrahedron beyond the threshold */
} tm_rotation_report;
#define TM_ROTATION_LANES 8
TM_API tm_rotation_report tm_rotation_last(const tm_rotation *rotation);

/* Energy of the correction at u [3*vertex_count] m, J: added to tm_tissue_energy it is what the tissue stores. */
TM_API double tm_rotation_energy(const tm_rotation *rotation, const double *u_m);
/* force_N [3*vertex_count] := the correction's force there, N: added to tm_tissue_force it is the tissue's. */
TM_API void tm_rotation_force(const tm_rotation *rotation, const double *u_m, double *force_N);

/* Of the definition. */
TM_API double tm_tissue_rotation(const tm_tissue *tissue);
/* Replaces the tensors of a tissue that nothing steps by those of its law where it has turned: of each tetrahedron
 * R K R^T, R its rotation at u_m [3*vertex_count] m. That is the tangent of the law without what stress adds to it, and
 * so positive semidefinite at every u; exact where strains are small. `threshold`: as tm_tissue_def.rotation.
 * TM_DOUBLE; with averaged shear (smoothed_shear_share above 0): TM_ERR_ARGUMENT. Takes memory while it runs. */
TM_API tm_status tm_tissue_corotate(tm_tissue *tissue, double threshold, const double *u_m, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
