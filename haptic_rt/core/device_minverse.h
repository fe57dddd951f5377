/* Haply Minverse, by the same service as the Inverse3 (io/drive_haply.c). The force limit is ours; mass and friction of
 * the twin are estimates: the maker publishes none. */

#ifdef HRT_DESCRIBE
static const hrt_device_type minverse_type = {
    CURSOR("minverse", "Haply Minverse: force at a cursor; roll and grip of a VerseGrip", 2.5f)};
#endif

#ifdef HRT_TWIN
static const hrt_twin minverse_twin = {CURSOR_TWIN(0.08, 0.2, 0.1)};
#endif
