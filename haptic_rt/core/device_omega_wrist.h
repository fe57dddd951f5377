/* Force Dimension with a wrist (omega.6, omega.7) whose direction is the shaft's: for an instrument without a trocar.
 * Limits and twin as device_omega.h. */

#ifdef HRT_DESCRIBE
static const hrt_device_type omega_wrist_type = {
    HANDLE("omega_wrist", "Force Dimension with a wrist (omega.6): also the handle's direction", 12.0f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin omega_wrist_twin = {CURSOR_TWIN(0.35, 0.4, 0.1)};
#endif
