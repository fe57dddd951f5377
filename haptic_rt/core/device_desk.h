/* A fictitious desk device for tests: a stylus on three slides, without roll, grip or trocar. Its joints are zero at
 * the scene's trocar. */

static void desk_tip(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL tip_m[3]) {
    turn(axes->r, 1, joint, tip_m);
}

static void desk_jacobian(const HRT_AXES *axes, const HRT_REAL joint[HRT_JOINTS], HRT_REAL jacobian[9]) {
    (void)joint;
    for (int i = 0; i < 9; i++) jacobian[i] = axes->r[i];
}

static bool desk_inverse(const HRT_AXES *axes, const HRT_REAL tip_m[3], HRT_REAL joint3[3]) {
    const HRT_REAL size = size_of(tip_m), most = (HRT_REAL)HRT_SIZE_MAX;
    if (!(size < most)) return false;
    turn_back(axes->r, tip_m, joint3);
    return true;
}

#ifdef HRT_DESCRIBE
static const hrt_device_type desk_type = {
    NAMED("desk", "a made-up desk device of three slides, for tests and trials", "force_x_N", "force_y_N", "force_z_N")
        .joints = 3,
    .motors = 3,
    .joint = {JOINT("x_m", 40000.0f, -0.15f, 0.15f, 3.0f, -0.6f, 0.6f),
              JOINT("y_m", 40000.0f, -0.15f, 0.15f, 3.0f, -0.6f, 0.6f),
              JOINT("z_m", 40000.0f, -0.05f, 0.25f, 3.0f, -0.6f, 0.6f)},
    .torque_max = {3.2f, 3.2f, 3.2f},
    .force_max_N = 3.2f,
    .rounding_m = 1.0e-6f,
    .insertion = -1,
    .roll = -1,
    .grip = -1,
    GEOMETRY(desk)};
#endif

#ifdef HRT_TWIN
static HRT_REAL desk_lever(const HRT_REAL joint[HRT_JOINTS], int j) {
    (void)joint, (void)j;
    return 1.0;
}

static const hrt_twin desk_twin = {.inertia = {0.15, 0.15, 0.15},
                                   .viscous = {0.4, 0.4, 0.4},
                                   .coulomb = {0.05, 0.05, 0.05},
                                   .hand_stiffness = {300.0, 300.0, 300.0},
                                   .hand_damping = {11.0, 11.0, 11.0},
                                   .rest = {0.0, 0.0, 0.1},
                                   .lever = desk_lever,
                                   GEOMETRY(desk)};
#endif
