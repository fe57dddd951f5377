/* The Impulse Engine: a gimbal at the trocar (pitch outside, yaw inside) with a sliding shaft. */
#ifndef HRT_ENGINE_IMPULSE_H
#define HRT_ENGINE_IMPULSE_H

/* The joints in their order, as the columns of tables name them. */
#define HRT_ENGINE_JOINTS "pitch_rad", "yaw_rad", "insertion_m", "roll_rad", "grip"
#define HRT_ENGINE_FIELDS "pitch_rad,yaw_rad,insertion_m,roll_rad,grip"
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

typedef struct gimbal {
    HRT_REAL sp, cp, sy, cy; /* sines and cosines of pitch and yaw */
} gimbal;

static void turn_gimbal(const HRT_REAL joint[HRT_JOINTS], gimbal *g) {
    HRT_SINE_COSINE(joint[HRT_PITCH], &g->sp, &g->cp);
    HRT_SINE_COSINE(joint[HRT_YAW], &g->sy, &g->cy);
}

void HRT_KINEMATICS(tip)(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    gimbal g;
    turn_gimbal(joint, &g);
    const HRT_REAL along[3] = {g.sy, g.sp * g.cy, g.cp * g.cy};
    turn(axes->r, joint[HRT_INSERTION], along, tip_m);
}

void HRT_KINEMATICS(jacobian)(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
    const HRT_REAL d = joint[HRT_INSERTION];
    gimbal g;
    turn_gimbal(joint, &g);
    const HRT_REAL column[3][3] = {
        {0, g.cp * g.cy, -g.sp * g.cy}, {g.cy, -g.sp * g.sy, -g.cp * g.sy}, {g.sy, g.sp * g.cy, g.cp * g.cy}};
    for (int j = 0; j < 3; j++) {
        HRT_REAL world[3];
        turn(axes->r, j == HRT_INSERTION ? 1 : d, column[j], world);
        for (int i = 0; i < 3; i++) jacobian[3 * i + j] = world[i];
    }
}

bool HRT_KINEMATICS(inverse)(const HRT_AXES *axes, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    const HRT_REAL *r = axes->r;
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

#endif
