/* The devices (core/device_types.h) in the simulation's precision: kinematics as in hrt.h, and parameters of the
 * virtual device. Metres relative to the trocar. */
#ifndef HRT_KINEMATICS_H
#define HRT_KINEMATICS_H

#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_twin hrt_twin;

typedef struct hrt_axes64 {
    double r[9]; /* as hrt_axes */
    const hrt_device_type *device;
    const hrt_twin *twin;
} hrt_axes64;

/* Turning of a handle about its point, across the shaft; inertia 0: the handle follows the hand and feels no torque. */
typedef struct hrt_turning {
    double inertia_kg_m2; /* handle and held hand */
    double viscous_Nm_s, coulomb_Nm;
    double hand_stiffness_Nm, hand_damping_Nm_s; /* N m/rad, N m s/rad */
} hrt_turning;

/* Mass, friction, hand and geometry of a virtual device, per driven joint: kg m^2 of a rotary one, kg of a sliding one,
 * and so on. */
struct hrt_twin {
    double inertia[HRT_MOTORS];        /* device and held hand */
    double viscous[HRT_MOTORS];        /* N m s or N s/m */
    double coulomb[HRT_MOTORS];        /* N m or N */
    double hand_stiffness[HRT_MOTORS]; /* N m/rad or N/m */
    double hand_damping[HRT_MOTORS];
    double rest[HRT_JOINTS]; /* initial joints */
    hrt_turning turning;
    /* Returns the tip's travel per unit of driven joint j, m. */
    double (*lever)(const double joint[HRT_JOINTS], int j);
    void (*tip)(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]);
    void (*jacobian)(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]);
    bool (*inverse)(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]);
};
/* Returns the twin of a device of hrt_device_types. */
const hrt_twin *hrt_twin_of(const hrt_device_type *device);

/* Sets the axes. Returns false, with the identity, if axis and up are parallel, zero, not finite or beyond 1e-100 to
 * 1e100. */
bool hrt_axes_along64(hrt_axes64 *axes, const hrt_device_type *device, const double axis[3], const double up[3]);
void hrt_tip64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]);
/* Computes d tip / d (driven joints), row-major 3x3. */
void hrt_jacobian64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]);
/* Computes the driven joints for a tip position. Returns false if there are none: the Impulse Engine's within 1 um of
 * the trocar. */
bool hrt_inverse64(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]);
/* Computes the tip of a straight shaft through the trocar: pitch rad, yaw rad, insertion m. Scenes give poses so for
 * every device; these are the Impulse Engine's joints. */
void hrt_shaft_tip64(const hrt_axes64 *axes, const double shaft[3], double tip_m[3]);
/* Computes the shaft's pitch, yaw and insertion. Returns false within 1 um of the trocar. */
bool hrt_shaft_of_tip64(const hrt_axes64 *axes, const double tip_m[3], double shaft[3]);
/* Computes the unit direction of a free instrument's shaft, as hrt_direction. */
void hrt_direction64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double direction[3]);
/* Computes the tilt of a shaft with this unit direction. Away from z, which tilts by half a turn, it is continuous. */
void hrt_tilt64(const hrt_axes64 *axes, const double direction[3], double tilt_rad[2]);
void hrt_counts_to_joint64(const hrt_params *params, const int32_t count[HRT_JOINTS], double joint[HRT_JOINTS]);
/* Returns the count of joint `j` at a value, not rounded. */
double hrt_count_of_joint64(const hrt_params *params, int j, double value);

#ifdef __cplusplus
}
#endif
#endif
