/* Phases of a hand's work: touch, press, slide, grasp, lift, cut, let go. */
#include <math.h>
#include <string.h>

#include "studies/replay/replay.h"

/* Seconds after an event that still belong to it. */
static const double touch_s = 0.1, grasp_s = 0.2, let_go_s = 0.3, cut_s = 0.1, slide_m_s = 3e-3;

void phase_watch_begin(phase_watch *w) {
    *w = (phase_watch){.touched_s = -1, .closed_s = -1, .opened_s = -1, .cut_s = -1};
}

phase phase_at(phase_watch *w, const sim *s, int instrument, double time_s, const float tip_m[3]) {
    const tm_tool_pose *pose = &s->pose[instrument];
    const double *f = s->reaction[instrument].force_N;
    const bool touching = f[0] != 0 || f[1] != 0 || f[2] != 0;
    float moved[3] = {tip_m[0] - w->tip_m[0], tip_m[1] - w->tip_m[1], tip_m[2] - w->tip_m[2]};
    if (s->instrument_def[instrument].mode == TM_TOOL_GRASPER) {
        if (!w->closed && pose->grip >= 0.7) w->closed = true, w->closed_s = time_s;
        if (w->closed && pose->grip <= 0.3) w->closed = false, w->opened_s = time_s;
    }
    if (touching != w->touching) w->touching = touching, w->touched_s = time_s;
    if (s->cuts.count) w->cut_s = time_s;
    memcpy(w->tip_m, tip_m, sizeof w->tip_m);
    if (time_s - w->opened_s < let_go_s) return PHASE_LET_GO;
    if (w->closed && time_s - w->closed_s < grasp_s) return PHASE_GRASP;
    if (touching && time_s - w->cut_s < cut_s) return PHASE_CUT;
    if (w->closed) return PHASE_LIFT;
    if (time_s - w->touched_s < touch_s) return PHASE_TOUCH;
    if (!touching) return PHASE_FREE;
    const float speed = sqrtf(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]) / (1e-6f * TICK_US);
    const double size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    const double along = (moved[0] * f[0] + moved[1] * f[1] + moved[2] * f[2]) / size / (1e-6 * TICK_US);
    const double across = sqrt(fmax((double)speed * (double)speed - along * along, 0));
    return across > slide_m_s && across > fabs(along) ? PHASE_SLIDE : PHASE_PRESS;
}
