/* Pairs of two bodies that are out of the lists' reach, but may meet in this substep because one side is fast: tissue
 * that a tool crushed and releases moves by several mm. They get rows as pairs within reach do, at a distance of up to
 * twice their relative motion in the last substep. Without a fast vertex nothing is searched. */
#include "touch/touch_internal.h"

#include <math.h>

#include "base/vec.h"

/* Motion in a substep from which a vertex is fast, of the thickness. Slower ones meet within the lists' reach. */
static const double FAST = 0.5;

static double motion2_of(const tm_touching *t, int32_t v) {
    double d[3];
    vsub(t->world->state.u_m + 3 * (int64_t)v, t->world->state.u_prev_m + 3 * (int64_t)v, d);
    return vdot(d, d);
}

/* --- boxes of bodies --- */

static void box_bodies(tm_touching *t) {
    for (int32_t b = 0; b < t->def.body_count; b++) t->box[b] = tm_touch_no_box();
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double x[3];
        tm_touch_at(t->world, t->surface.vertex[i], x);
        tm_touch_box_add(t->box + t->surface.body[t->surface.vertex[i]], x);
    }
}

/* Returns whether a ball is in the box of another body that the body touches. */
static bool is_near_another(const tm_touching *t, int32_t body, const tm_touch_ball *ball) {
    for (int32_t b = 0; b < t->def.body_count; b++) {
        bool near = b != body && tm_touch_enabled(t, body, b);
        for (int c = 0; c < 3; c++)
            near &= ball->middle[c] + ball->radius_m >= t->box[b].low[c] &&
                    ball->middle[c] - ball->radius_m <= t->box[b].high[c];
        if (near) return true;
    }
    return false;
}

/* --- pairs --- */

static void try_pair(tm_touching *t, int32_t v, int32_t face) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t body = t->surface.body[v], other = tm_touch_body(t, face);
    if (body == other || !tm_touch_enabled(t, body, other)) return;
    double p[3], x[3][3], moved[3];
    int32_t w[3];
    tm_touch_triangle(t, face, w);
    tm_touch_at(t->world, v, p);
    for (int j = 0; j < 3; j++) tm_touch_at(t->world, w[j], x[j]);
    const tm_touch_closest c = tm_touch_point_triangle(p, x[0], x[1], x[2]);
    const double *u = t->world->state.u_m, *before = t->world->state.u_prev_m, full = t->def.thickness_m;
    vsub(u + 3 * (int64_t)v, before + 3 * (int64_t)v, moved);
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++) moved[k] -= c.weight[j] * (u[3 * w[j] + k] - before[3 * w[j] + k]);
    if (!(c.distance_m <= 1.25 * full + 2 * vnorm(moved))) return;
    const double *rest = mesh->rest_m;
    const double rest_m =
        tm_touch_point_triangle(rest + 3 * v, rest + 3 * w[0], rest + 3 * w[1], rest + 3 * w[2]).distance_m;
    const double thickness_m = law_min(full, rest_m);
    if (!(c.distance_m > thickness_m + full)) return; /* within the lists' reach */
    if (t->fast.vf.count == t->fast.vf.room) {
        t->report.overflowed = true;
        return;
    }
    t->fast.vf.pair[t->fast.vf.count++] = (tm_touch_pair){.a = v, .b = face, .thickness_m = thickness_m};
}

/* Returns a ball in which all places are with which a feature may meet. */
static tm_touch_ball reach_of(const tm_touching *t, const double middle[3], double radius_m, double motion_m) {
    tm_touch_ball ball = {.radius_m = radius_m + 1.25 * t->def.thickness_m + 4 * motion_m};
    vset(middle, ball.middle);
    return ball;
}

/* Finds features around the ball; the clusters hold them in places that may be half a margin off. */
static int32_t find(tm_touching *t, int kind, const tm_touch_ball *ball) {
    const tm_touch_surface *s = &t->surface;
    int32_t *found = t->near_items;
    const tm_touch_bounds near =
        tm_touch_bounds_around(ball->middle, ball->middle, ball->radius_m + tm_touch_misplaced_m(t));
    if (!t->all_pairs) return tm_touch_clusters_find(t->clusters + kind, &near, found);
    const int32_t count = kind == TM_TOUCH_FACES ? s->face_count : s->vertex_count;
    for (int32_t i = 0; i < count; i++) found[i] = kind == TM_TOUCH_FACES ? s->face[i] : s->vertex[i];
    return count;
}

static void search_vertex(tm_touching *t, int32_t v) {
    double x[3];
    const double motion2 = motion2_of(t, v);
    tm_touch_at(t->world, v, x);
    const tm_touch_ball ball = reach_of(t, x, 0, sqrt(motion2));
    if (!is_near_another(t, t->surface.body[v], &ball)) return;
    const int32_t count = find(t, TM_TOUCH_FACES, &ball);
    for (int32_t i = 0; i < count; i++) try_pair(t, v, t->near_items[i]);
}

static void search_face(tm_touching *t, int32_t face) {
    double x[3][3], motion2 = 0, radius2 = 0, d[3];
    int32_t w[3];
    tm_touch_triangle(t, face, w);
    for (int j = 0; j < 3; j++) {
        motion2 = law_max(motion2, motion2_of(t, w[j]));
        tm_touch_at(t->world, w[j], x[j]);
        vsub(x[j], x[0], d);
        radius2 = law_max(radius2, vdot(d, d));
    }
    const tm_touch_ball ball = reach_of(t, x[0], sqrt(radius2), sqrt(motion2));
    if (!is_near_another(t, tm_touch_body(t, face), &ball)) return;
    const int32_t count = find(t, TM_TOUCH_VERTICES, &ball);
    for (int32_t i = 0; i < count; i++) try_pair(t, t->near_items[i], face);
}

static bool is_quick(const tm_touching *t, int32_t v) {
    return motion2_of(t, v) > FAST * FAST * t->def.thickness_m * t->def.thickness_m;
}

void tm_touch_find_fast(tm_touching *t) {
    t->fast.vf.count = 0;
    if (t->def.body_count < 2 || t->world->settling || !(t->increment_m > FAST * t->def.thickness_m)) return;
    if (!tm_touch_list_quick(t, is_quick)) return;
    box_bodies(t);
    for (int32_t i = 0; i < t->quick[TM_TOUCH_VERTICES].count; i++)
        search_vertex(t, t->quick[TM_TOUCH_VERTICES].list[i]);
    for (int32_t i = 0; i < t->quick[TM_TOUCH_FACES].count; i++) search_face(t, t->quick[TM_TOUCH_FACES].list[i]);
    tm_touch_list_merge(&t->fast.vf, 0, t->scratch);
    tm_touch_list_drop_doubles(&t->fast.vf);
}
