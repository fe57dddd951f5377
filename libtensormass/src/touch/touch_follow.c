/* Surfaces near another body that is behind them. Either that body is inside, or the surface was pushed through its own
 * body and is inside out: rows on it would push to the wrong side. So paths of their vertices are followed
 * (touch_crossing.c). Bodies that lie flush are no such case: their rows begin at the rest distance, and load presses
 * them a little into each other. */
#include "touch/touch_internal.h"

/* Depth up to which load may press a surface behind one that was near at rest, of the thickness. */
static const double PRESSED = 0.1;

static bool is_pressed(const tm_touching *t, const tm_touch_pair *pair, double depth_m) {
    return pair->thickness_m < t->def.thickness_m && depth_m < PRESSED * t->def.thickness_m;
}

void tm_touch_follow(tm_touching *t, const tm_touch_pair *pair, double depth_m, const int32_t *vertex, int count) {
    if (is_pressed(t, pair, depth_m)) return;
    for (int j = 0; j < count && t->followed_count < TM_TOUCH_MAX_FOLLOWED; j++) {
        if (t->is_followed[vertex[j]]) continue;
        t->is_followed[vertex[j]] = 1;
        t->followed[t->followed_count++] = vertex[j];
    }
}

void tm_touch_forget_followed(tm_touching *t) {
    for (int32_t i = 0; i < t->followed_count; i++) t->is_followed[t->followed[i]] = 0;
    t->followed_count = 0;
}
