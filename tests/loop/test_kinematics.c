/* Geometry of every device: derivative against differences, inverse, virtual work; single and double agree. */
#include "motion/kinematics.h"
#include "rig.h"

static hrt_axes some_axes(const hrt_device_type *device, uint64_t *seed) {
    hrt_axes axes;
    float axis[3], up[3];
    do
        for (int i = 0; i < 3; i++) {
            axis[i] = rig_uniform(seed, -1.0f, 1.0f);
            up[i] = rig_uniform(seed, -1.0f, 1.0f);
        }
    while (!hrt_axes_along(&axes, device, axis, up));
    return axes;
}

/* Within the workspace; a shaft's insertion keeps 2 cm from the trocar. */
static void some_joints(const hrt_device_type *device, uint64_t *seed, float joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++) {
        const hrt_joint_type *type = &device->joint[j];
        joint[j] = j < device->joints ? rig_uniform(seed, j == device->insertion ? 0.02f : type->min, type->max) : 0.0f;
    }
}

static void check_jacobian(const hrt_device_type *device) {
    uint64_t seed = 1;
    for (int k = 0; k < 2000; k++) {
        const hrt_axes axes = some_axes(device, &seed);
        float joint[HRT_JOINTS], keep[HRT_JOINTS], jacobian[9], before[3], after[3];
        some_joints(device, &seed, joint);
        memcpy(keep, joint, sizeof keep);
        hrt_jacobian(&axes, joint, jacobian);
        for (int j = 0; j < 3; j++) {
            const float h = 1.0e-3f;
            joint[j] = keep[j] - h;
            hrt_tip(&axes, joint, before);
            joint[j] = keep[j] + h;
            hrt_tip(&axes, joint, after);
            joint[j] = keep[j];
            for (int i = 0; i < 3; i++)
                assert_float_equal((after[i] - before[i]) / (2.0f * h), jacobian[3 * i + j], 1.0e-4);
        }
    }
}

static void jacobian_is_the_derivative(void **state) {
    (void)state;
    assert_true(hrt_device_type_count >= 2);
    for (int32_t t = 0; t < hrt_device_type_count; t++) check_jacobian(hrt_device_types[t]);
}

static void inverse_of_kinematics_returns_the_joints(void **state) {
    (void)state;
    uint64_t seed = 2;
    for (int k = 0; k < 4000; k++) {
        const hrt_device_type *device = hrt_device_types[k % hrt_device_type_count];
        const hrt_axes axes = some_axes(device, &seed);
        float joint[HRT_JOINTS], back[3], tip[3];
        some_joints(device, &seed, joint);
        hrt_tip(&axes, joint, tip);
        assert_true(hrt_inverse(&axes, tip, back));
        for (int j = 0; j < device->motors; j++) assert_float_equal(back[j], joint[j], 2.0e-6);
    }
    const float nowhere[3] = {0.0f, 0.0f, 0.0f};
    float joint[3];
    const hrt_axes axes = some_axes(hrt_device_types[0], &seed);
    assert_false(hrt_inverse(&axes, nowhere, joint));
}

/* Checks the properties of a description that the programs rely on. */
static void device_descriptions_are_complete(void **state) {
    (void)state;
    for (int32_t t = 0; t < hrt_device_type_count; t++) {
        const hrt_device_type *d = hrt_device_types[t];
        hrt_params params;
        assert_int_equal(hrt_device_type_find(d->name), t);
        assert_int_equal(hrt_device_type_number(d), t);
        assert_true(d->joints >= 1 && d->joints <= HRT_JOINTS && d->motors >= 1 && d->motors <= HRT_MOTORS);
        assert_true(d->motors <= d->joints && d->insertion < d->motors && d->roll < d->joints && d->grip < d->joints);
        hrt_params_of_device(&params, d);
        assert_int_equal(hrt_params_check(&params), -1);
        for (int j = 0; j < d->joints; j++) {
            const hrt_joint_type *joint = &d->joint[j];
            assert_true(joint->name && joint->reach_min <= joint->min && joint->max <= joint->reach_max);
            assert_true(fmaxf(fabsf(joint->min), joint->max) * joint->counts_per_unit < 32767.0f);
        }
        for (int j = 0; j < d->motors; j++) assert_true(d->torque_name[j] && hrt_twin_of(d)->inertia[j] > 0);
    }
    assert_int_equal(hrt_device_type_find("impulse"), -1);
}

/* A handle's tilt: both precisions give the same direction, a unit vector, and its tilt is the one given. */
static void tilt_is_that_of_the_direction(void **state) {
    (void)state;
    uint64_t seed = 6;
    int tilting = 0;
    for (int k = 0; k < 4000; k++) {
        const hrt_device_type *device = hrt_device_types[k % hrt_device_type_count];
        const hrt_axes axes = some_axes(device, &seed);
        hrt_axes64 wide = {.device = device};
        float joint[HRT_JOINTS], e[3];
        double joint64[HRT_JOINTS], e64[3], tilt[2], square = 0, angle;
        some_joints(device, &seed, joint);
        for (int i = 0; i < 9; i++) wide.r[i] = (double)axes.r[i];
        for (int j = 0; j < HRT_JOINTS; j++) joint64[j] = (double)joint[j];
        hrt_direction(&axes, joint, e);
        hrt_direction64(&wide, joint64, e64);
        for (int i = 0; i < 3; i++) {
            square += e64[i] * e64[i];
            assert_true(fabs((double)e[i] - e64[i]) < 1e-6);
            if (!device->tilts) assert_true(fabs(e64[i] - wide.r[3 * i + 2]) < 1e-15);
        }
        assert_true(fabs(square - 1) < 1e-6);
        hrt_tilt64(&wide, e64, tilt);
        angle = hypot(joint64[HRT_TILT], joint64[HRT_TILT + 1]);
        if (!device->tilts || angle > 3.1) continue;
        tilting++;
        for (int i = 0; i < 2; i++) assert_true(fabs(tilt[i] - joint64[HRT_TILT + i]) < 1e-4);
    }
    assert_true(tilting > 500);
}

static void frame_is_a_rotation(void **state) {
    (void)state;
    uint64_t seed = 3;
    for (int k = 0; k < 500; k++) {
        const hrt_axes f = some_axes(hrt_device_types[k % hrt_device_type_count], &seed);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                float dot = 0.0f;
                for (int i = 0; i < 3; i++) dot += f.r[3 * i + a] * f.r[3 * i + b];
                assert_float_equal(dot, (a == b ? 1.0f : 0.0f), 1.0e-6f);
            }
        const float det = f.r[0] * (f.r[4] * f.r[8] - f.r[5] * f.r[7]) - f.r[1] * (f.r[3] * f.r[8] - f.r[5] * f.r[6]) +
                          f.r[2] * (f.r[3] * f.r[7] - f.r[4] * f.r[6]);
        assert_float_equal(det, 1.0f, 1.0e-5);
    }
    hrt_axes f;
    const float z[3] = {0, 0, 1}, y[3] = {0, 1, 0}, zero[3] = {0, 0, 0}, nan[3] = {NAN, 0, 1};
    assert_true(hrt_axes_along(&f, hrt_device_types[0], z, y));
    assert_false(hrt_axes_along(&f, hrt_device_types[0], z, z));
    assert_false(hrt_axes_along(&f, hrt_device_types[0], zero, y));
    assert_false(hrt_axes_along(&f, hrt_device_types[0], nan, y));
}

/* Torque by the transpose does the work of the force: tau . dq = F . dP. */
static void torques_do_the_work_of_the_force(void **state) {
    (void)state;
    rig r;
    rig_engage(&r);
    r.force_N[0] = 0.8f;
    r.force_N[1] = -0.5f;
    rig_run(&r, 0.5);
    float jacobian[9];
    hrt_jacobian(&r.c.axes, r.out.joint, jacobian);
    for (int j = 0; j < 3; j++) {
        float torque = 0.0f;
        for (int i = 0; i < 3; i++) torque += jacobian[3 * i + j] * r.out.force_N[i];
        assert_float_equal(torque, r.out.torque[j], 1.0e-6);
    }
    assert_float_equal(r.out.torque[HRT_INSERTION], -2.0f, 1.0e-5); /* straight down the shaft */
    assert_float_equal(r.out.torque[HRT_YAW], 0.8f * 0.1f, 1.0e-5);
    assert_float_equal(r.out.torque[HRT_PITCH], -0.5f * 0.1f, 1.0e-5);
}

/* The controller's tip equals the simulation's for the same joints, over everything that a message may contain; the
 * controller gets its axes from the simulation (SIM_STATUS). */
static void check_precisions(const hrt_device_type *device) {
    uint64_t seed = 4;
    double tip_worst = 0, jacobian_worst = 0;
    for (int k = 0; k < 20000; k++) {
        hrt_axes64 wide;
        hrt_axes axes;
        double axis[3], up[3], joint[HRT_JOINTS] = {0}, tip[3], jacobian[9], back[3];
        float axis_f[3], up_f[3], joint_f[HRT_JOINTS] = {0}, tip_f[3], jacobian_f[9];
        do
            for (int i = 0; i < 3; i++) {
                axis[i] = (double)rig_uniform(&seed, -1.0f, 1.0f);
                up[i] = (double)rig_uniform(&seed, -1.0f, 1.0f);
            }
        while (!hrt_axes_along64(&wide, device, axis, up));
        for (int i = 0; i < 3; i++) axis_f[i] = (float)wide.r[3 * i + 2], up_f[i] = (float)wide.r[3 * i + 1];
        assert_true(hrt_axes_along(&axes, device, axis_f, up_f));
        for (int j = 0; j < device->joints; j++)
            joint[j] =
                (double)(joint_f[j] = rig_uniform(&seed, device->joint[j].reach_min, device->joint[j].reach_max));
        hrt_tip64(&wide, joint, tip);
        hrt_tip(&axes, joint_f, tip_f);
        for (int i = 0; i < 3; i++) tip_worst = fmax(tip_worst, fabs(tip[i] - (double)tip_f[i]));
        hrt_jacobian64(&wide, joint, jacobian);
        hrt_jacobian(&axes, joint_f, jacobian_f);
        for (int i = 0; i < 9; i++) jacobian_worst = fmax(jacobian_worst, fabs(jacobian[i] - (double)jacobian_f[i]));
        const bool turns = device->insertion >= 0;
        if (turns && (!(joint[2] > 1e-3) || fabs(joint[0]) > 1.5 || fabs(joint[1]) > 1.5)) continue;
        assert_true(hrt_inverse64(&wide, tip, back));
        for (int j = 0; j < device->motors; j++) assert_true(fabs(back[j] - joint[j]) < 1e-13);
    }
    print_message("%s, float against double: tip %.2g m, Jacobian %.2g\n", device->name, tip_worst, jacobian_worst);
    assert_true(tip_worst < (double)device->rounding_m);
    assert_true(tip_worst > (double)device->rounding_m / 20); /* and no looser than necessary */
    assert_true(jacobian_worst < 2e-6);
}

static void both_precisions_agree(void **state) {
    (void)state;
    for (int32_t t = 0; t < hrt_device_type_count; t++) check_precisions(hrt_device_types[t]);
}

static void counts_convert_there_and_back(void **state) {
    (void)state;
    hrt_params p;
    hrt_params_default(&p);
    for (int j = 0; j < HRT_JOINTS; j++) p.count_zero[j] = 100.0f * (float)j;
    for (int32_t at = -32000; at <= 32000; at += 7) {
        const int32_t count[HRT_JOINTS] = {at, at, at, at, at};
        double wide[HRT_JOINTS];
        float narrow[HRT_JOINTS];
        hrt_counts_to_joint64(&p, count, wide);
        hrt_counts_to_joint(&p, count, narrow);
        for (int j = 0; j < p.device->joints; j++) {
            assert_true(fabs(wide[j] - (double)narrow[j]) <= 1e-7 * fabs(wide[j]));
            assert_int_equal(lrint(hrt_count_of_joint64(&p, j, wide[j])), at);
            assert_int_equal(lrintf(hrt_count_of_joint(&p, j, narrow[j])), at);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(jacobian_is_the_derivative),       cmocka_unit_test(inverse_of_kinematics_returns_the_joints),
        cmocka_unit_test(tilt_is_that_of_the_direction),    cmocka_unit_test(frame_is_a_rotation),
        cmocka_unit_test(torques_do_the_work_of_the_force), cmocka_unit_test(both_precisions_agree),
        cmocka_unit_test(device_descriptions_are_complete), cmocka_unit_test(counts_convert_there_and_back)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
