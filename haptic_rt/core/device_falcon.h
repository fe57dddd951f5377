/* Novint Falcon, by Force Dimension's library (io/drive_dhd.c). Force limit 8.9 N, as in the wiki of H3DAPI
 * (github.com/SenseGraphics/h3dapi/wiki/Novint_Falcon: "> 8.9 N", "approximate"). Mass and friction of the twin are
 * estimates. */

#ifdef HRT_DESCRIBE
static const hrt_device_type falcon_type = {CURSOR("falcon", "Novint Falcon: force at a ball; grip by a button", 8.9f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin falcon_twin = {CURSOR_TWIN(0.35, 0.8, 0.4)};
#endif
