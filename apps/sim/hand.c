/* The scene's hand without a device: where a scripted hand wants its instrument. */
#include <math.h>
#include <string.h>

#include "sim.h"

static double ease(double s, bool straight) { return straight ? s : s * s * s * (10 + s * (6 * s - 15)); }

void sim_hand_target(const sim *s, int instrument, double time_s, double joint[SIM_JOINTS], bool *active) {
    const app_hand *hand = sim_hand(s, instrument);
    memcpy(joint, s->start_joint[instrument], sizeof(double) * SIM_JOINTS);
    *active = s->instrument_def[instrument].mode != TM_TOOL_CAUTERY;
    if (!hand) return;
    const app_waypoint *w = hand->path.item;
    int n = hand->path.count, i = 0;
    double last = w[n - 1].time.si;
    if (hand->repeat.on && last > 0) time_s = fmod(time_s, last);
    while (i + 1 < n && w[i + 1].time.si <= time_s) ++i;
    double from[SIM_JOINTS], to[SIM_JOINTS];
    sim_scene_joints(s, instrument, &w[i].pose, from);
    if (w[i].active.on && time_s >= w[i].time.si) *active = true;
    double share = 0;
    memcpy(to, from, sizeof to);
    if (i + 1 < n && time_s > w[i].time.si) {
        sim_scene_joints(s, instrument, &w[i + 1].pose, to);
        share = ease((time_s - w[i].time.si) / (w[i + 1].time.si - w[i].time.si), hand->between.index == 1);
    }
    for (int j = 0; j < SIM_JOINTS; ++j) joint[j] = from[j] + share * (to[j] - from[j]);
    if (!hand->tremor.line) return;
    /* Two incommensurate frequencies about the mean; along the shaft and across it. */
    double a = hand->tremor_amplitude.si, f = 2 * M_PI * hand->tremor_frequency.si * time_s;
    joint[2] += a * 0.5 * (sin(0.83 * f) + sin(1.17 * f + 1));
    joint[0] += a / joint[2] * 0.5 * (sin(0.91 * f + 2) + sin(1.09 * f + 3));
    joint[1] += a / joint[2] * 0.5 * (sin(0.87 * f + 4) + sin(1.13 * f + 5));
}
