/* The devices (core/device_types.h) in the simulation's precision: what hrt.h declares for the tick, and what the
 * virtual device is made of. Metres relative to the trocar. */
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

/* Mass, friction and hand of a virtual device, by driven joint (kg m^2 of a turning one, kg of a sliding one, and so
 * on), and its geometry. */
struct hrt_twin {
    double inertia[HRT_MOTORS];        /* device and held hand */
    double viscous[HRT_MOTORS];        /* N m s or N s/m */
    double coulomb[HRT_MOTORS];        /* N m or N */
    double hand_stiffness[HRT_MOTORS]; /* N m/rad or N/m */
    double hand_damping[HRT_MOTORS];
    double rest[HRT_JOINTS]; /* where it starts */
    /* Metres that the tip moves for a unit of driven joint j. */
    double (*lever)(const double joint[HRT_JOINTS], int j);
    void (*tip)(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]);
    void (*jacobian)(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]);
    bool (*inverse)(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]);
};
/* Of a device of hrt_device_types. */
const hrt_twin *hrt_twin_of(const hrt_device_type *device);

/* False, and the identity, where axis and up are parallel, zero, not finite or beyond 1e-100 to 1e100. */
bool hrt_axes_along64(hrt_axes64 *axes, const hrt_device_type *device, const double axis[3], const double up[3]);
void hrt_tip64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]);
/* d tip / d (driven joints), row-major 3x3. */
void hrt_jacobian64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]);
/* The driven joints that put the tip there; false where none do: the Impulse Engine's within 1 um of the trocar. */
bool hrt_inverse64(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]);
/* Pitch rad, yaw rad and insertion m of a straight shaft through the trocar, in which scenes give poses whatever the
 * device; the joints of the Impulse Engine. */
void hrt_shaft_tip64(const hrt_axes64 *axes, const double shaft[3], double tip_m[3]);
/* False within 1 um of the trocar. */
bool hrt_shaft_of_tip64(const hrt_axes64 *axes, const double tip_m[3], double shaft[3]);
void hrt_counts_to_joint64(const hrt_params *params, const int32_t count[HRT_JOINTS], double joint[HRT_JOINTS]);
/* The count of joint `j` at a value, not rounded. */
double hrt_count_of_joint64(const hrt_params *params, int j, double value);

#ifdef __cplusplus
}
#endif
#endif
