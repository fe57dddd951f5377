/* The Impulse Engine as the programs know it: its axes, limits and counts, and below them its geometry, a
 * gimbal at the trocar (pitch outside, yaw inside) with a sliding shaft.
 *
 * The geometry is included once for `float`, the controller's (core/kinematics.c), and once for the simulation's
 * precision (device/kinematics.c): the includer sets HRT_REAL, HRT_FRAME, HRT_KINEMATICS(name), the functions HRT_SQRT,
 * HRT_ASIN, HRT_ATAN2 and HRT_SINE_COSINE, and HRT_SIZE_MIN and _MAX, between which a square keeps its digits. */
#ifndef HRT_ENGINE_H
#define HRT_ENGINE_H

/* The joints in their order, as the columns of tables name them. */
#define HRT_ENGINE_JOINTS "pitch_rad", "yaw_rad", "insertion_m", "roll_rad", "grip"
#define HRT_ENGINE_COLUMNS "pitch_rad,yaw_rad,insertion_m,roll_rad,grip"
/* The profile's defaults, a number a joint (device/profiles/impulse_engine.profile says where they are from). */
#define HRT_ENGINE_COUNTS_PER_UNIT 8000.0f, 8000.0f, 40000.0f, 700.0f, 250.0f
#define HRT_ENGINE_JOINT_MIN -0.8f, -0.8f, 0.01f, -10.0f, 0.0f
#define HRT_ENGINE_JOINT_MAX 0.8f, 0.8f, 0.25f, 10.0f, 1.0f
#define HRT_ENGINE_SPEED_MAX 20.0f, 20.0f, 3.0f, 100.0f, 50.0f
#define HRT_ENGINE_TORQUE_MAX 1.4f, 1.4f, 8.9f
#define HRT_ENGINE_FORCE_MAX_N 8.9f
/* What no such device says, whatever its profile: a message with more is wrong. */
#define HRT_ENGINE_REACH_MIN -1.65, -1.65, -0.05, -1e3, -0.1
#define HRT_ENGINE_REACH_MAX 1.65, 1.65, 0.6, 1e3, 1.1
/* Two tips of the same joints within that reach, one of each precision, are no farther apart. */
#define HRT_ENGINE_ROUNDING_M 1e-6

#endif

#ifdef HRT_REAL

static HRT_REAL size_of(const HRT_REAL a[3]) { return HRT_SQRT(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/* y = s M x, row-major 3x3. */
static inline void turn(const HRT_REAL m[9], HRT_REAL s, const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = s * (m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]);
}

static inline void cross(const HRT_REAL a[3], const HRT_REAL b[3], HRT_REAL c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static bool make_unit(const HRT_REAL a[3], HRT_REAL unit[3]) {
    const HRT_REAL most = (HRT_REAL)HRT_SIZE_MAX, least = (HRT_REAL)HRT_SIZE_MIN;
    for (int i = 0; i < 3; i++) /* not by isfinite: the firmware build may be told that no NaN exists */
        if (!(a[i] >= -most && a[i] <= most)) return false;
    const HRT_REAL size = size_of(a);
    if (!(size > least) || !(size < most)) return false;
    for (int i = 0; i < 3; i++) unit[i] = a[i] / size;
    return true;
}

bool HRT_KINEMATICS(frame_from_axis)(HRT_FRAME *frame, const HRT_REAL axis[3], const HRT_REAL up[3]) {
    HRT_REAL z[3], y[3], x[3], unit_up[3];
    for (int i = 0; i < 9; i++) frame->r[i] = (HRT_REAL)(i % 4 == 0);
    if (!make_unit(axis, z) || !make_unit(up, unit_up)) return false;
    cross(unit_up, z, y);
    if (!(size_of(y) > (HRT_REAL)1.0e-3) || !make_unit(y, x)) return false;
    cross(z, x, y); /* last, so that all three are perpendicular to rounding however slanted `up` is */
    for (int i = 0; i < 3; i++) {
        HRT_REAL *row = frame->r + (ptrdiff_t)3 * i;
        row[0] = x[i], row[1] = y[i], row[2] = z[i];
    }
    return true;
}

typedef struct gimbal {
    HRT_REAL sp, cp, sy, cy; /* sines and cosines of pitch and yaw */
} gimbal;

static void turn_gimbal(const HRT_REAL joint[HRT_JOINTS], gimbal *g) {
    HRT_SINE_COSINE(joint[HRT_PITCH], &g->sp, &g->cp);
    HRT_SINE_COSINE(joint[HRT_YAW], &g->sy, &g->cy);
}

void HRT_KINEMATICS(tip)(const HRT_FRAME *frame, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    gimbal g;
    turn_gimbal(joint, &g);
    const HRT_REAL along[3] = {g.sy, g.sp * g.cy, g.cp * g.cy};
    turn(frame->r, joint[HRT_INSERTION], along, tip_m);
}

void HRT_KINEMATICS(jacobian)(const HRT_FRAME *frame, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
    const HRT_REAL d = joint[HRT_INSERTION];
    gimbal g;
    turn_gimbal(joint, &g);
    const HRT_REAL column[3][3] = {
        {0, g.cp * g.cy, -g.sp * g.cy}, {g.cy, -g.sp * g.sy, -g.cp * g.sy}, {g.sy, g.sp * g.cy, g.cp * g.cy}};
    for (int j = 0; j < 3; j++) {
        HRT_REAL world[3];
        turn(frame->r, j == HRT_INSERTION ? 1 : d, column[j], world);
        for (int i = 0; i < 3; i++) jacobian[3 * i + j] = world[i];
    }
}

bool HRT_KINEMATICS(inverse)(const HRT_FRAME *frame, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    const HRT_REAL *r = frame->r;
    HRT_REAL p[3];
    for (int i = 0; i < 3; i++) p[i] = r[i] * tip_m[0] + r[3 + i] * tip_m[1] + r[6 + i] * tip_m[2];
    const HRT_REAL d = size_of(p), most = (HRT_REAL)HRT_SIZE_MAX;
    if (!(d > (HRT_REAL)1.0e-6) || !(d < most)) return false;
    const HRT_REAL across = p[0] / d;
    joint3[HRT_PITCH] = HRT_ATAN2(p[1], p[2]);
    joint3[HRT_YAW] = HRT_ASIN(across < -1 ? -1 : across > 1 ? 1 : across);
    joint3[HRT_INSERTION] = d;
    return true;
}

void HRT_KINEMATICS(counts_to_joint)(const hrt_params *params, const int32_t count[HRT_JOINTS],
                                     HRT_REAL joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++)
        joint[j] = ((HRT_REAL)count[j] - (HRT_REAL)params->count_zero[j]) / (HRT_REAL)params->counts_per_unit[j];
}

/* Not rounded: an encoder may add its noise first. */
HRT_REAL HRT_KINEMATICS(count_of_joint)(const hrt_params *params, int j, HRT_REAL value) {
    return value * (HRT_REAL)params->counts_per_unit[j] + (HRT_REAL)params->count_zero[j];
}

#endif
