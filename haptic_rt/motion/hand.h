/* Scripted hands: keyframes of an instrument's joints, minimum-jerk or linear between them, with tremor. */
#ifndef HRT_HAND_H
#define HRT_HAND_H

#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_keyframe {
    double time_s;
    double joint[HRT_JOINTS];
    bool active; /* pedal from this key on */
} hrt_keyframe;

/* Target of the hand over time. Before the first key: the first; after the last: the last, or a repetition. */
typedef struct hrt_hand_script {
    const hrt_keyframe *key; /* owned by the caller, times ascending; null: stays at `rest` */
    int32_t key_count;
    bool straight; /* linear instead of minimum-jerk */
    bool repeat;
    double tremor_m;  /* amplitude at the tip, across the shaft and along it */
    double tremor_hz; /* default 9 */
} hrt_hand_script;

/* Computes the hand's target; `rest` without keys. `*active` is the pedal, unchanged without keys. */
void hrt_hand_target(const hrt_hand_script *hand, const hrt_device_type *device, const double rest[HRT_JOINTS],
                     double time_s, double target[HRT_JOINTS], bool *active);
/* Adds the tremor at a time to joints. */
void hrt_hand_tremble(const hrt_hand_script *hand, const hrt_device_type *device, double time_s,
                      double target[HRT_JOINTS]);

#ifdef __cplusplus
}
#endif
#endif
