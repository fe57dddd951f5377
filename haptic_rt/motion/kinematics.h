/* The device's geometry (core/engine.h) in the simulation's precision: what hrt.h declares for the tick. Metres
 * relative to the trocar. */
#ifndef HRT_KINEMATICS_H
#define HRT_KINEMATICS_H

#include "engine.h"
#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_axes64 {
    double r[9]; /* as hrt_axes */
} hrt_axes64;

/* False, and the identity, where axis and up are parallel, zero, not finite or beyond 1e-100 to 1e100. */
bool hrt_axes_along64(hrt_axes64 *axes, const double axis[3], const double up[3]);
void hrt_tip64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]);
/* d tip / d (pitch, yaw, insertion), row-major 3x3. */
void hrt_jacobian64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]);
/* pitch, yaw, insertion that put the tip there; false within 1 um of the trocar. */
bool hrt_inverse64(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]);
void hrt_counts_to_joint64(const hrt_params *params, const int32_t count[HRT_JOINTS], double joint[HRT_JOINTS]);
/* The count of joint `j` at a value, not rounded. */
double hrt_count_of_joint64(const hrt_params *params, int j, double value);

#ifdef __cplusplus
}
#endif
#endif
