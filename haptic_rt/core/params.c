/* The parameter table: name, unit, range and default of every float of hrt_params. Three arrays are built from it;
 * firmware does not link the texts. */
#include "internal.h"

#if HRT_WITH_FREE
#define HANDLE_PARAMETERS(ROW)                                                                                         \
    ROW(handle_torque_max_Nm, "N m", 0.0f, 5.0f, "largest torque at the handle, vector sum; 0: none", 0.0f)            \
    ROW(arm_m, "m", 0.0f, 0.5f, "from the handle's point to the tip, where torque is rendered", 0.0f)
#else
#define HANDLE_PARAMETERS(ROW)
#endif

#define PARAMETERS(ROW, ROWS)                                                                                          \
    ROWS(counts_per_unit, "1/joint unit", 1.0f, 1.0e6f, "encoder counts per joint unit")                               \
    ROWS(count_zero, "counts", -32768.0f, 32767.0f, "encoder count at joint value zero")                               \
    ROWS(joint_min, "rad, m or 1", -100.0f, 100.0f, "workspace, lower end")                                            \
    ROWS(joint_max, "rad, m or 1", -100.0f, 100.0f, "workspace, upper end")                                            \
    ROWS(speed_max, "joint unit/s", 0.01f, 1000.0f, "largest joint speed; a higher one is an encoder jump")            \
    ROWS(torque_max, "N m or N", 0.0f, 100.0f, "largest torque of each motor")                                         \
    ROW(force_max_N, "N", 0.0f, 20.0f, "largest force at the tip, vector sum", 0.0f)                                   \
    HANDLE_PARAMETERS(ROW)                                                                                             \
    ROW(axis_power_max_W, "W", 0.01f, 100.0f, "largest power that one joint delivers to the hand", 3.0f)               \
    ROW(power_max_W, "W", 0.01f, 100.0f, "largest power that all joints deliver to the hand", 5.0f)                    \
    ROW(slew_max_N_s, "N/s", 10.0f, 20000.0f, "largest rate of change of the force vector", 600.0f)                    \
    ROW(axis_slew_max_N_s, "N/s", 10.0f, 20000.0f, "largest rate of change along one world axis", 450.0f)              \
    ROW(stiffness_max_N_m, "N/m", 1.0f, 1.0e6f, "largest Frobenius norm of a received or estimated stiffness",         \
        5000.0f)                                                                                                       \
    ROW(horizon_us, "us", 1000.0f, 2.0e6f, "longest extrapolation in time after t_n", 150000.0f)                       \
    ROW(horizon_m, "m", 1.0e-5f, 0.2f, "longest extrapolation in position from P_n", 0.02f)                            \
    ROW(ratio_max, "1", 0.5f, 100.0f, "largest extrapolated change of force, as a multiple of the last difference",    \
        4.0f)                                                                                                          \
    ROW(standstill_m, "m", 1.0e-7f, 0.01f, "displacement below which no stiffness is estimated: about two counts",     \
        5.0e-5f)                                                                                                       \
    ROW(blend_us, "us", 0.0f, 1.0e6f, "time from no force to the complete force", 70000.0f)                            \
    ROW(patch_stale_us, "us", 1000.0f, 2.0e6f, "age of t_n above which a patch is not used", 300000.0f)                \
    ROW(stale_us, "us", 5000.0f, 2.0e6f, "age of t_n at which the force begins to ramp down", 100000.0f)               \
    ROW(fade_us, "us", 1000.0f, 1.0e6f, "time of the ramp down to no force", 40000.0f)                                 \
    ROW(ramp_us, "us", 1000.0f, 5.0e6f, "time of the ramp up to the complete force", 200000.0f)                        \
    ROW(device_pause_us, "us", 4000.0f, 1.0e6f, "encoder silence after which the force is set to 0", 12000.0f)         \
    ROW(tick_pause_us, "us", 3000.0f, 1.0e6f, "lateness of a tick after which the force is set to 0", 15000.0f)        \
    ROW(device_timeout_us, "us", 4000.0f, 1.0e6f, "encoder silence after which there is a fault", 100000.0f)           \
    ROW(tick_timeout_us, "us", 3000.0f, 1.0e6f, "lateness of a tick after which there is a fault", 250000.0f)          \
    ROW(self_test_us, "us", 2000.0f, 5.0e6f, "time of good frames before the self test is passed", 100000.0f)          \
    ROW(self_test_timeout_us, "us", 10000.0f, 6.0e7f, "time after which the self test has failed", 3.0e6f)             \
    ROW(stuck_us, "us", 10000.0f, 1.0e7f, "time of an unchanged count after which an encoder is stuck", 150000.0f)     \
    ROW(stuck_torque, "1", 0.05f, 2.0f, "change of torque in that time, as a share of its maximum", 0.4f)              \
    ROW(passivity_damping_max_N_s_m, "N s/m", 0.0f, 200.0f, "largest damping of the passivity controller", 20.0f)      \
    ROW(passivity_reset_us, "us", 1000.0f, 1.0e7f, "time without force after which the energy account is reset",       \
        50000.0f)                                                                                                      \
    ROW(coupling_N_m, "N/m", 50.0f, 1.0e5f, "stiffness above which the virtual coupling carries the force", 2000.0f)   \
    ROW(coupling_N_s_m, "N s/m", 0.0f, 200.0f, "damping of the virtual coupling", 2.0f)                                \
    ROW(velocity_filter_us, "us", 0.0f, 100000.0f, "time constant of the velocity estimate", 8000.0f)

#define RANGE(field, unit, low, high, ...)                                                                             \
    {(uint16_t)offsetof(hrt_params, field),                                                                            \
     (uint8_t)((sizeof(((hrt_params *)0)->field) + sizeof(float) - 1u) / sizeof(float)), low, high},
#define WORDS(field, unit, low, high, text, ...) {#field, unit, text},
#define DEFAULT(field, unit, low, high, text, value) .field = (value),
#define DEVICES_OWN(...)

const hrt_param_range hrt_param_table[] = {PARAMETERS(RANGE, RANGE)};
const hrt_param_words hrt_param_text[] = {PARAMETERS(WORDS, WORDS)};
const int32_t hrt_param_count = (int32_t)(sizeof hrt_param_table / sizeof hrt_param_table[0]);
static const hrt_params defaults = {PARAMETERS(DEFAULT, DEVICES_OWN)};

void hrt_params_of_device(hrt_params *params, const hrt_device_type *device) {
    *params = defaults;
    params->device = device;
    params->period_us = 2000.0f;
    for (int32_t j = 0; j < hrt_joints(params); j++) {
        params->counts_per_unit[j] = device->joint[j].counts_per_unit;
        params->joint_min[j] = device->joint[j].min;
        params->joint_max[j] = device->joint[j].max;
        params->speed_max[j] = device->joint[j].speed_max;
    }
    for (int32_t j = 0; j < hrt_motors(params); j++) params->torque_max[j] = device->torque_max[j];
    params->force_max_N = device->force_max_N;
#if HRT_WITH_FREE
    params->handle_torque_max_Nm = device->handle_torque_max_Nm;
    params->arm_m = device->arm_m;
#endif
}

void hrt_params_default(hrt_params *params) { hrt_params_of_device(params, hrt_device_types[0]); }

int32_t hrt_param_values(const hrt_params *params, const hrt_param_range *row) {
    return row->count == HRT_JOINTS ? hrt_joints(params) : row->count == HRT_MOTORS ? hrt_motors(params) : 1;
}

int32_t hrt_params_check(const hrt_params *params) {
    if (!params->device) return 0;
    int32_t joint_min_row = 0;
    for (int32_t r = 0; r < hrt_param_count; r++) {
        const hrt_param_range *row = &hrt_param_table[r];
        const float *value = (const float *)(const void *)((const unsigned char *)params + row->offset);
        const int32_t count = hrt_param_values(params, row);
        for (int32_t i = 0; i < count; i++)
            if (!(value[i] >= row->min && value[i] <= row->max)) return r;
        if (row->offset == offsetof(hrt_params, joint_min)) joint_min_row = r;
    }
    for (int32_t j = 0; j < hrt_joints(params); j++)
        if (!(params->joint_min[j] < params->joint_max[j])) return joint_min_row;
    return -1;
}
