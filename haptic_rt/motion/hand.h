/* Scripted hands: keyframes of an instrument's joints, minimum-jerk or straight between them, with tremor. */
#ifndef HRT_HAND_H
#define HRT_HAND_H

#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_keyframe {
    double time_s;
    double joint[HRT_JOINTS];
    bool active; /* pedal from here on */
} hrt_keyframe;

/* Where the hand wants the instrument. Before the first key: the first; after the last: the last, or again from the
 * start. */
typedef struct hrt_hand_script {
    const hrt_keyframe *key; /* caller's, times ascending; null: stays at `rest` */
    int32_t key_count;
    bool straight; /* straight lines instead of minimum-jerk */
    bool repeat;
    double tremor_m;  /* amplitude at the tip, across the shaft and along it */
    double tremor_hz; /* 9 */
} hrt_hand_script;

/* Where such a hand wants its instrument; `rest` without keys. `*active` is the pedal: left as it is without keys. */
void hrt_hand_target(const hrt_hand_script *hand, const hrt_device_type *device, const double rest[HRT_JOINTS],
                     double time_s, double target[HRT_JOINTS], bool *active);
/* Adds the tremor at a time to joints. */
void hrt_hand_tremble(const hrt_hand_script *hand, const hrt_device_type *device, double time_s,
                      double target[HRT_JOINTS]);

#ifdef __cplusplus
}
#endif
#endif
