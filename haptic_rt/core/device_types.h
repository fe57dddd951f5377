/* The devices of this build. A device is one file device_NAME.h, included below, and one row. Firmware for the Impulse
 * Engine alone defines HRT_ONE_DEVICE.
 *
 * A device's file is compiled twice: in `float` for the controller (core/kinematics.c), and in the simulation's
 * precision (motion/kinematics.c). The includer defines HRT_REAL, HRT_AXES, HRT_SQRT, HRT_ASIN, HRT_ATAN2 and
 * HRT_SINE_COSINE. HRT_SIZE_MIN and _MAX bound the lengths whose squares keep their digits.
 *
 * The file defines, for a row `NAME`: NAME_tip, NAME_jacobian and NAME_inverse. With HRT_DESCRIBE it also defines
 * NAME_type, the device's description. With HRT_TWIN it defines NAME_twin and NAME_lever, parameters of the virtual
 * device and its hand (motion/kinematics.h). Devices whose cursor is a point share the three slides of device_cursor.h.
 * Shared helpers follow. */

static HRT_REAL size_of(const HRT_REAL a[3]) { return HRT_SQRT(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/* Computes y = s M x, row-major 3x3. */
static inline void turn(const HRT_REAL m[9], HRT_REAL s, const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = s * (m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]);
}

/* Computes y = M^T x. */
static inline void turn_back(const HRT_REAL m[9], const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = m[i] * x[0] + m[3 + i] * x[1] + m[6 + i] * x[2];
}

/* NAMED: name and text of a device, names of its torques. JOINT: name, counts per unit; minimum, maximum and top speed
 * of the profile; minimum and maximum of any profile. */
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
#include "device_cursor.h"
#include "device_desk.h"
/* Those that share the two above. */
#include "device_crtk.h"
#include "device_crtk_handle.h"
#include "device_falcon.h"
#include "device_inverse3.h"
#include "device_inverse3_versegrip.h"
#include "device_minverse.h"
#include "device_omega.h"
#include "device_omega_wrist.h"
#include "device_sigma.h"
#include "device_touch.h"
#include "device_touch_stylus.h"
#define HRT_DEVICE_TYPES(ROW)                                                                                          \
    ROW(impulse_engine)                                                                                                \
    ROW(desk)                                                                                                          \
    ROW(inverse3)                                                                                                      \
    ROW(touch)                                                                                                         \
    ROW(omega)                                                                                                         \
    ROW(falcon)                                                                                                        \
    ROW(minverse) ROW(inverse3_versegrip) ROW(touch_stylus) ROW(crtk) ROW(crtk_handle) ROW(omega_wrist) ROW(sigma)
#endif
