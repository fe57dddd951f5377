/* Haply Inverse3, by its service (io/drive_haply.c). The cursor's three slides are along the joint axes of
 * io/workspace.h. Resolution 20 um over CAN frames, finer by the service. The force limit is ours. Mass and friction of
 * the twin are estimates. */

#ifdef HRT_DESCRIBE
static const hrt_device_type inverse3_type = {
    CURSOR("inverse3", "Haply Inverse3: force at a cursor; roll and grip of a VerseGrip", 5.0f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin inverse3_twin = {CURSOR_TWIN(0.12, 0.3, 0.15)};
#endif
