/* Haply Inverse3 with a VerseGrip, whose direction is the shaft's: for an instrument without a trocar. Limits and twin
 * as device_inverse3.h; the handle's mass is part of the hand's. */

#ifdef HRT_DESCRIBE
static const hrt_device_type inverse3_versegrip_type = {
    HANDLE("inverse3_versegrip", "Haply Inverse3 with a VerseGrip: also the handle's direction", 5.0f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin inverse3_versegrip_twin = {CURSOR_TWIN(0.12, 0.3, 0.15)};
#endif
