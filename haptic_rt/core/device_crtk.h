/* A master of the Collaborative Robotics Toolkit (CRTK), as of the da Vinci Research Kit, by a bridge to ROS 2
 * (io/drive_crtk.c). The force limit is ours; mass and friction of the twin are estimates. */

#ifdef HRT_DESCRIBE
static const hrt_device_type crtk_type = {
    CURSOR("crtk", "CRTK master (dVRK): force at a cursor; roll, grip by the gripper", 5.0f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin crtk_twin = {CURSOR_TWIN(0.6, 0.6, 0.4)};
#endif
