#include "layout.h"

#include <math.h>
#include <string.h>

void view_layout_take(view_layout *l, float x0, float y0, float x1, float y1) {
    if (l->count == VIEW_LAYOUT_MAX) return;
    memcpy(l->box[l->count++], (float[4]){x0, y0, x1, y1}, sizeof l->box[0]);
}

bool view_layout_taken(const view_layout *l, const float b[4]) {
    for (int i = 0; i < l->count; i++)
        if (b[0] < l->box[i][2] && l->box[i][0] < b[2] && b[1] < l->box[i][3] && l->box[i][1] < b[3]) return true;
    return false;
}

/* The best place touches the edge of a box along one axis. Along the other it is as near as possible: unchanged, or at
 * an edge too. */
void view_layout_find_space(const view_layout *l, float width, float height, float gap, float b[4]) {
    if (!view_layout_taken(l, b)) return;
    float w = b[2] - b[0], h = b[3] - b[1], best = 1e9f, x[2 * VIEW_LAYOUT_MAX + 1], y[2 * VIEW_LAYOUT_MAX + 1],
          from[2];
    int count = 0;
    x[count] = from[0] = b[0], y[count++] = from[1] = b[1];
    for (int i = 0; i < l->count; i++) {
        x[count] = l->box[i][0] - w - gap, y[count++] = l->box[i][1] - h - gap;
        x[count] = l->box[i][2] + gap, y[count++] = l->box[i][3] + gap;
    }
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) {
            const float at[4] = {x[i], y[j], x[i] + w, y[j] + h};
            float away = hypotf(at[0] - from[0], at[1] - from[1]);
            if (away >= best || at[0] < 0 || at[1] < 0 || at[2] > width || at[3] > height || view_layout_taken(l, at))
                continue;
            best = away;
            memcpy(b, at, sizeof at);
        }
}
