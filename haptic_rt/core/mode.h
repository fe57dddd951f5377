/* Modes of an instrument, as scenes, options and messages name them. tm_tool_mode of the library has the same numbers
 * (asserted in apps/sim/tools.c). */
#ifndef HRT_MODE_H
#define HRT_MODE_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HRT_MODES(ROW)                                                                                                 \
    ROW(PROBE, "probe")                                                                                                \
    ROW(GRASPER, "grasper")                                                                                            \
    ROW(CAUTERY, "cautery")
#define HRT_MODE_OF(mode, name) HRT_MODE_##mode,
typedef enum hrt_mode { HRT_MODES(HRT_MODE_OF) HRT_MODE_COUNT } hrt_mode;
#define HRT_MODE_NAME_OF(mode, name) " " name
#define HRT_MODE_NAMES HRT_MODES(HRT_MODE_NAME_OF) /* string literal; each name follows a blank */

const char *hrt_mode_name(hrt_mode mode);
/* Returns false for an unknown name. */
bool hrt_mode_find(const char *name, hrt_mode *mode);

#ifdef __cplusplus
}
#endif
#endif
