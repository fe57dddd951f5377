/* The Impulse Engine: a gimbal at the trocar (pitch outside, yaw inside) with a sliding shaft. In the device's axes,
 * tip = insertion * (sin yaw, sin pitch cos yaw, cos pitch cos yaw). */

typedef struct gimbal {
    HRT_REAL sp, cp, sy, cy; /* sines and cosines of pitch and yaw */
} gimbal;

static void turn_gimbal(const HRT_REAL joint[HRT_JOINTS], gimbal *g) {
    HRT_SINE_COSINE(joint[HRT_PITCH], &g->sp, &g->cp);
    HRT_SINE_COSINE(joint[HRT_YAW], &g->sy, &g->cy);
}

static void impulse_engine_tip(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    gimbal g;
    turn_gimbal(joint, &g);
    const HRT_REAL along[3] = {g.sy, g.sp * g.cy, g.cp * g.cy};
    turn(axes->r, joint[HRT_INSERTION], along, tip_m);
}

static void impulse_engine_jacobian(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
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

static bool impulse_engine_inverse(const HRT_AXES *axes, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    HRT_REAL p[3];
    turn_back(axes->r, tip_m, p);
    const HRT_REAL d = size_of(p), most = (HRT_REAL)HRT_SIZE_MAX;
    if (!(d > (HRT_REAL)1.0e-6) || !(d < most)) return false;
    const HRT_REAL across = p[0] / d;
    joint3[HRT_PITCH] = HRT_ATAN2(p[1], p[2]);
    joint3[HRT_YAW] = HRT_ASIN(across < -1 ? -1 : across > 1 ? 1 : across);
    joint3[HRT_INSERTION] = d;
    return true;
}

#ifdef HRT_DESCRIBE
/* device/profiles/impulse_engine.profile gives the sources of these numbers. */
static const hrt_device_type impulse_engine_type = {
    NAMED("impulse_engine", "Laparoscopic Impulse Engine: pitch, yaw and insertion at a trocar, roll and grip",
          "torque_pitch_Nm", "torque_yaw_Nm", "force_insertion_N")
        .joints = 5,
    .motors = 3,
    .joint = {JOINT("pitch_rad", 8000.0f, -0.8f, 0.8f, 20.0f, -1.65f, 1.65f),
              JOINT("yaw_rad", 8000.0f, -0.8f, 0.8f, 20.0f, -1.65f, 1.65f),
              JOINT("insertion_m", 40000.0f, 0.01f, 0.25f, 3.0f, -0.05f, 0.6f),
              JOINT("roll_rad", 700.0f, -10.0f, 10.0f, 100.0f, -1.0e3f, 1.0e3f),
              JOINT("grip", 250.0f, 0.0f, 1.0f, 50.0f, -0.1f, 1.1f)},
    .torque_max = {1.4f, 1.4f, 8.9f},
    .force_max_N = 8.9f,
    .rounding_m = 1.0e-6f,
    .insertion = HRT_INSERTION,
    .roll = HRT_ROLL,
    .grip = HRT_GRIP,
    GEOMETRY(impulse_engine)};
#endif

#ifdef HRT_TWIN
/* Returns the tip's travel per unit of driven joint j, m; the lever is at least 2 cm. */
static HRT_REAL impulse_engine_lever(const HRT_REAL joint[HRT_JOINTS], int j) {
    return j == HRT_INSERTION ? 1.0 : fmax(joint[HRT_INSERTION], 0.02);
}

static const hrt_twin impulse_engine_twin = {.inertia = {0.0045, 0.0045, 0.2},
                                             .viscous = {0.01, 0.01, 0.5},
                                             .coulomb = {0.008, 0.008, 0.06},
                                             .hand_stiffness = {7.0, 7.0, 300.0},
                                             .hand_damping = {0.25, 0.25, 11.0},
                                             .rest = {0.0, 0.0, 0.1},
                                             .lever = impulse_engine_lever,
                                             GEOMETRY(impulse_engine)};
#endif
