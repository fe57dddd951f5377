#include "sample_rate.h"

#include <math.h>

#include "effects.h"

/* `auto`: no device feels more, and the law has nothing left to guess. */
static const double top_Hz = 500;
/* Fastest rate with patches: one costs some milliseconds. */
static const double patch_rate_max_Hz = 50;

int32_t sim_stream_per_frame(const app_scene *scene) {
    const sim_haptics *haptics = sim_options(scene, "haptics");
    if (!haptics || scene->pace == SIM_FRAMES) return 1;
    const bool automatic = haptics->rate.si == 0;
    const double wanted = (automatic ? top_Hz : haptics->rate.si) / scene->frame_rate.si;
    const int32_t count = (int32_t)(automatic ? floor(wanted + 1e-9) : round(wanted));
    return count > 1 ? count : 1;
}

sim_sends sim_stream_sends_by_rate(double rate_Hz) {
    return rate_Hz <= patch_rate_max_Hz * (1 + 1e-9) ? SIM_SENDS_PATCH : SIM_SENDS_FORCE;
}

sim_sends sim_stream_sends(const sim *s, double rate_Hz) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    const bool frames = s->scene->pace == SIM_FRAMES;
    return !haptics || haptics->sends.line || frames ? SIM_SENDS_PATCH : sim_stream_sends_by_rate(rate_Hz);
}
