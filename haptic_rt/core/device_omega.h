/* Force Dimension omega, by the maker's library (io/drive_dhd.c). Force limit 12 N is a typical value from memory, not
 * checked against a data sheet: a profile (--profile) replaces it. Mass and friction of the twin are estimates. */

#ifdef HRT_DESCRIBE
static const hrt_device_type omega_type = {
    CURSOR("omega", "Force Dimension omega: force at a cursor; roll, grip by a button", 12.0f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin omega_twin = {CURSOR_TWIN(0.35, 0.4, 0.1)};
#endif
