/* The devices that this build knows. A device is one file device_NAME.h, included below, and one row; firmware for one
 * device alone, here the Impulse Engine, defines HRT_ONE_DEVICE.
 *
 * A device's file is compiled twice: for `float`, the controller's (core/kinematics.c), and for the simulation's
 * precision (motion/kinematics.c). The includer sets HRT_REAL, HRT_AXES, HRT_SQRT, HRT_ASIN, HRT_ATAN2 and
 * HRT_SINE_COSINE, and HRT_SIZE_MIN and _MAX, between which a square keeps its digits. The file defines, for a row
 * `NAME`: NAME_tip, NAME_jacobian, NAME_inverse; where HRT_DESCRIBE is defined also `NAME_type`, its numbers; where
 * HRT_TWIN is defined `NAME_twin` and NAME_lever, what the virtual device and its hand are made of
 * (motion/kinematics.h). Helpers for all stand here. */

static HRT_REAL size_of(const HRT_REAL a[3]) { return HRT_SQRT(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/* y = s M x, row-major 3x3. */
static inline void turn(const HRT_REAL m[9], HRT_REAL s, const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = s * (m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]);
}

/* y = M^T x. */
static inline void turn_back(const HRT_REAL m[9], const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = m[i] * x[0] + m[3 + i] * x[1] + m[6 + i] * x[2];
}

/* Name and text of a device and names of its torques; a joint: name, counts a unit, lowest, highest and fastest of the
 * profile, lowest and highest of all. */
#ifdef HRT_ONE_DEVICE
#define GEOMETRY(name)
#else
#define GEOMETRY(name_) .tip = name_##_tip, .jacobian = name_##_jacobian, .inverse = name_##_inverse,
#endif
#if HRT_WITH_WORDS
#define NAMED(name_, text_, ...) .name = (name_), .text = (text_), .torque_name = {__VA_ARGS__},
#define JOINT(name_, counts, low, high, fast, reach_low, reach_high)                                                   \
    { counts, low, high, fast, reach_low, reach_high, name_ }
#else
#define NAMED(...)
#define JOINT(name_, counts, low, high, fast, reach_low, reach_high)                                                   \
    { counts, low, high, fast }
#endif

#include "device_impulse_engine.h"
#ifdef HRT_ONE_DEVICE
#define HRT_DEVICE_TYPES(ROW) ROW(impulse_engine)
#else
#include "device_desk.h"
#define HRT_DEVICE_TYPES(ROW) ROW(impulse_engine) ROW(desk)
#endif
