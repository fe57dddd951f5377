/* 3D Systems Touch whose stylus gives the shaft's direction: for an instrument without a trocar. Limits and twin as
 * device_touch.h. */

#ifdef HRT_DESCRIBE
static const hrt_device_type touch_stylus_type = {
    HANDLE("touch_stylus", "3D Systems Touch (Phantom Omni): also the stylus's direction", 3.3f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin touch_stylus_twin = {CURSOR_TWIN(0.145, 0.3, 0.26)};
#endif
