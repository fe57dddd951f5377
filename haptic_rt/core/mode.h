/* What an instrument does, as scenes, options and messages name it; tm_tool_mode of the library has the same numbers
 * (apps/sim/tools.c asserts it). */
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
#define HRT_MODE_NAMES HRT_MODES(HRT_MODE_NAME_OF) /* a string literal, each after a blank */

const char *hrt_mode_name(hrt_mode mode);
/* False: there is none of that name. */
bool hrt_mode_find(const char *name, hrt_mode *mode);

#ifdef __cplusplus
}
#endif
#endif
