/* Computes the target of a scripted hand. */
#include "hand.h"

#include "kinematics.h"

#include <math.h>
#include <string.h>

#include "libtensormass/numeric/elementary.h"

static const double PI = 3.14159265358979323846;

static double between(const hrt_hand_script *hand, double s) {
    return hand->straight ? s : s * s * s * (10.0 + s * (6.0 * s - 15.0));
}

static void scripted(const hrt_hand_script *hand, const double rest[HRT_JOINTS], double time_s,
                     double target[HRT_JOINTS], bool *active) {
    if (!hand->key || hand->key_count < 1) {
        memcpy(target, rest, sizeof(double) * HRT_JOINTS);
        return;
    }
    const double last_s = hand->key[hand->key_count - 1].time_s;
    if (hand->repeat && last_s > 0.0 && time_s > last_s) time_s = fmod(time_s, last_s);
    int32_t k = 0;
    while (k + 1 < hand->key_count && hand->key[k + 1].time_s <= time_s) k++;
    const hrt_keyframe *a = &hand->key[k], *b = &hand->key[k + 1 < hand->key_count ? k + 1 : k];
    const double span = b->time_s - a->time_s;
    const double s = span > 0.0 && time_s > a->time_s ? between(hand, (time_s - a->time_s) / span) : 0.0;
    for (int j = 0; j < HRT_JOINTS; j++) target[j] = a->joint[j] + s * (b->joint[j] - a->joint[j]);
    *active = a->active;
}

void hrt_hand_tremble(const hrt_hand_script *hand, const hrt_device_type *device, double time_s,
                      double target[HRT_JOINTS]) {
    static const double pace[HRT_MOTORS] = {1.0, 1.13, 0.91}, phase[HRT_MOTORS] = {0.0, 1.0, 2.0};
    if (!(hand->tremor_m > 0.0)) return;
    const hrt_twin *twin = hrt_twin_of(device);
    double lever[HRT_MOTORS];
    for (int j = 0; j < device->motors; j++) lever[j] = twin->lever(target, j);
    const double w = 2.0 * PI * hand->tremor_hz * time_s;
    for (int j = 0; j < device->motors; j++) target[j] += hand->tremor_m / lever[j] * tm_sine(pace[j] * w + phase[j]);
}

void hrt_hand_target(const hrt_hand_script *hand, const hrt_device_type *device, const double rest[HRT_JOINTS],
                     double time_s, double target[HRT_JOINTS], bool *active) {
    scripted(hand, rest, time_s, target, active);
    hrt_hand_tremble(hand, device, time_s, target);
}
