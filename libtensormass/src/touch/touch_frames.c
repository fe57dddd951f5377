/* Motion of bodies as a whole in a substep. A body that falls or is thrown crosses nothing of its own, however fast it
 * is, and others only where they are in its way. So a vertex is fast by its motion relative to the mean motion of its
 * own body, and to that of each body whose way meets the way of its own. Of two vertices that are fast relative to
 * neither body's motion, the pair is within the rows' reach. */
#include "touch/touch_internal.h"

#include <math.h>

#include "base/vec.h"

static void motion_of(const tm_touching *t, int32_t v, double d[3]) {
    vsub(t->world->state.u_next_m + 3 * (int64_t)v, t->world->state.u_m + 3 * (int64_t)v, d);
}

/* Adds the way of a vertex to its body's frame. */
static void add_way(const tm_touching *t, int32_t v, tm_touch_frame *frame) {
    double d[3], x[3];
    motion_of(t, v, d);
    vmadd(frame->motion_m, 1, d, frame->motion_m);
    for (int end = 0; end < 2; end++) {
        tm_touch_place_at(t, v, end, x);
        tm_touch_box_add(&frame->way, x);
    }
    frame->count++;
}

void tm_touch_find_frames(tm_touching *t) {
    t->frames_motion_m = 0;
    for (int32_t b = 0; b < t->def.body_count; b++) t->frame[b] = (tm_touch_frame){.way = tm_touch_no_box()};
    for (int32_t i = 0; i < t->surface.vertex_count; i++)
        add_way(t, t->surface.vertex[i], t->frame + t->surface.body[t->surface.vertex[i]]);
    for (int32_t b = 0; b < t->def.body_count; b++) {
        double *motion = t->frame[b].motion_m;
        vscale(1 / law_max(t->frame[b].count, 1), motion, motion);
        t->frames_motion_m = law_max(t->frames_motion_m, vnorm(motion));
    }
}

bool tm_touch_is_fast_in_frames(const tm_touching *t, int32_t v, double limit_m) {
    const int32_t body = t->surface.body[v];
    double d[3];
    motion_of(t, v, d);
    for (int32_t b = 0; b < t->def.body_count; b++) {
        const tm_touch_frame *frame = t->frame + b;
        double relative[3];
        vsub(d, frame->motion_m, relative);
        if (!(vdot(relative, relative) > limit_m * limit_m)) continue;
        if (b == body || (tm_touch_enabled(t, body, b) && tm_touch_boxes_overlap(&t->frame[body].way, &frame->way)))
            return true;
    }
    return false;
}
