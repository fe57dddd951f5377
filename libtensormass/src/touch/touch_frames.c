/* Motion of bodies as a whole in a substep. A body that falls or is thrown crosses nothing of its own, however fast it
 * is, and others only where they are in its way. So a vertex is fast by its motion relative to the mean motion of its
 * own body, and to that of each body whose way meets the way of its own. Of two vertices that are fast relative to
 * neither body's motion, the pair is within the rows' reach. */
#include "touch/touch_paths.h"

#include <math.h>

#include "base/vec.h"

static void find_motions(tm_touching *t) {
    t->frames_motion_m = 0;
    for (int32_t b = 0; b < t->def.body_count; b++) t->frame[b] = (tm_touch_frame){.count = 0};
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double d[3];
        tm_touch_frame *frame = t->frame + t->surface.body[t->surface.vertex[i]];
        tm_touch_motion(t, t->surface.vertex[i], d);
        vmadd(frame->motion_m, 1, d, frame->motion_m);
        frame->count++;
    }
    for (int32_t b = 0; b < t->def.body_count; b++) {
        double *motion = t->frame[b].motion_m;
        vscale(1 / law_max(t->frame[b].count, 1), motion, motion);
        t->frames_motion_m = law_max(t->frames_motion_m, vnorm(motion));
    }
}

static void find_ways(tm_touching *t) {
    for (int32_t b = 0; b < t->def.body_count; b++) t->frame[b].way = tm_touch_no_box();
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double from[3], to[3];
        tm_touch_box *way = &t->frame[t->surface.body[t->surface.vertex[i]]].way;
        tm_touch_ends(t, t->surface.vertex[i], from, to);
        tm_touch_box_add(way, from);
        tm_touch_box_add(way, to);
    }
}

static bool is_faster(const tm_touch_frame *frame, const double d[3], double limit_m) {
    double relative[3];
    vsub(d, frame->motion_m, relative);
    return vdot(relative, relative) > limit_m * limit_m;
}

/* Returns whether a vertex with this motion is fast relative to another body. Few are: ways are found then. */
static bool is_fast_to_others(tm_touching *t, int32_t body, const double d[3], double limit_m, bool *has_ways) {
    for (int32_t b = 0; b < t->def.body_count; b++) {
        if (b == body || !tm_touch_enabled(t, body, b) || !is_faster(t->frame + b, d, limit_m)) continue;
        if (!*has_ways) find_ways(t);
        *has_ways = true;
        if (tm_touch_boxes_overlap(&t->frame[body].way, &t->frame[b].way)) return true;
    }
    return false;
}

void tm_touch_find_frames(tm_touching *t, double limit_m) {
    find_motions(t);
    /* Up to here, motion is slow in every frame. */
    const double slow_m = law_max(limit_m - t->frames_motion_m, 0) * (1 - 1e-9);
    bool has_ways = false;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        const int32_t v = t->surface.vertex[i], body = t->surface.body[v];
        double d[3];
        tm_touch_motion(t, v, d);
        t->is_fast[v] = !(vdot(d, d) <= slow_m * slow_m) &&
                        (is_faster(t->frame + body, d, limit_m) || is_fast_to_others(t, body, d, limit_m, &has_ways));
    }
}
