/* 3D Systems Touch, by the maker's library (io/drive_touch.c). Force limit 3.3 N, apparent mass 45 g and friction 0.26
 * N are typical values from memory, not checked against a data sheet: a profile (--profile) replaces the limits. The
 * twin adds a hand of 0.1 kg. */

#ifdef HRT_DESCRIBE
static const hrt_device_type touch_type = {
    CURSOR("touch", "3D Systems Touch (Phantom Omni): force at a stylus; roll, grip by a button", 3.3f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin touch_twin = {CURSOR_TWIN(0.145, 0.3, 0.26)};
#endif
