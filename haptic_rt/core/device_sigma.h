/* Force Dimension with motors at the wrist (sigma.7, lambda.7, delta.6): the handle gives the shaft's direction and
 * takes torque. Limits and arm are ours: 0.2 N m hold 2 N across an arm of 0.1 m. Mass and friction of the twin are
 * estimates. */

#ifdef HRT_DESCRIBE
static const hrt_device_type sigma_type = {
    HANDLE("sigma", "Force Dimension with wrist motors (sigma.7): also the handle's direction, and torque there", 12.0f)
        .handle_torque_max_Nm = 0.2f,
    .arm_m = 0.1f};
#endif

#ifdef HRT_TWIN
static const hrt_twin sigma_twin = {HANDLE_TURNING, CURSOR_TWIN(0.4, 0.4, 0.1)};
#endif
