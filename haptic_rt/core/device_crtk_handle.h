/* CRTK master whose handle gives the shaft's direction and takes torque: for an instrument without a trocar. Limits and
 * arm are ours: 0.2 N m hold 2 N across an arm of 0.1 m. Twin as device_crtk.h, and the handle turns. */

#ifdef HRT_DESCRIBE
static const hrt_device_type crtk_handle_type = {
    HANDLE("crtk_handle", "CRTK master: also the handle's direction, and torque there", 5.0f).handle_torque_max_Nm =
        0.2f,
    .arm_m = 0.1f};
#endif

#ifdef HRT_TWIN
static const hrt_twin crtk_handle_twin = {HANDLE_TURNING, CURSOR_TWIN(0.6, 0.6, 0.4)};
#endif
