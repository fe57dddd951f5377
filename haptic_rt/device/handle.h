/* The handle of a virtual device that renders torque: it turns about its point against inertia, viscous and dry
 * friction, moved by the motors' torque and by a hand that holds it. Directions and torques are along the joint axes.
 */
#ifndef HRT_HANDLE_H
#define HRT_HANDLE_H

#include "motion/kinematics.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_handle {
    hrt_axes64 axes;      /* the joint axes themselves */
    double direction[3];  /* unit, of the shaft */
    double turn_rad_s[3]; /* across the direction */
} hrt_handle;

/* Sets the handle at rest with this tilt, rad; the device has one. */
void hrt_handle_init(hrt_handle *handle, const hrt_device_type *device, const double tilt_rad[2]);
/* Turns by dt_s under `torque_Nm`; the hand wants the tilt `wanted_rad`, which was `was_rad` dt_s ago. The tilt found
 * is at most `most_rad`. */
void hrt_handle_turn(hrt_handle *handle, const hrt_turning *turning, const double torque_Nm[3], const double was_rad[2],
                     const double wanted_rad[2], double most_rad, double dt_s, double tilt_rad[2]);
/* Computes the tip's place relative to the handle's point, less that of an upright shaft. */
void hrt_handle_swing(const hrt_handle *handle, const double tilt_rad[2], double arm_m, double swing_m[3]);

#ifdef __cplusplus
}
#endif
#endif
