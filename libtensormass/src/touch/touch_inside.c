/* Vertices inside another body. Rows keep surfaces apart, but where tissue is crushed, turned inside out and released,
 * a vertex may end on the wrong side, deeper than rows reach. So now and then a vertex is checked: one of those behind
 * a face of another body, and one of the complete surface in turn. One that is inside, and was not at rest, is pushed
 * to the nearest point of that body's surface until it is outside. The list is in the memory of the rows, and so in
 * snapshots. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Faces that are looked at in a substep, by each kind of check; a check takes all. And substeps between at most. */
enum { FACES = 512, PERIOD_MAX = 8 };
/* Depth from which a vertex is pushed out, of the thickness: rows of surfaces that are close at rest let it nearly as
 * far. */
static const double DEEP = 0.5;
static const double PI = 3.14159265358979;

/* --- inside or outside --- */

static void corner(const tm_touching *t, int32_t vertex, bool at_rest, double x[3]) {
    if (at_rest)
        vset(t->world->tissue->mesh->rest_m + 3 * (int64_t)vertex, x);
    else
        tm_touch_at(t->world, vertex, x);
}

/* Returns whether the surface of a body winds around a vertex. */
static bool is_wound(const tm_touching *t, int32_t vertex, int32_t body, bool at_rest) {
    double p[3], sum = 0;
    corner(t, vertex, at_rest, p);
    for (int32_t i = 0; i < t->surface.face_count; i++) {
        double x[3][3], r[3], cross[3];
        int32_t v[3];
        if (tm_touch_body(t, t->surface.face[i]) != body) continue;
        tm_touch_triangle(t, t->surface.face[i], v);
        for (int j = 0; j < 3; j++) {
            corner(t, v[j], at_rest, x[j]);
            vsub(x[j], p, x[j]);
            r[j] = vnorm(x[j]);
        }
        vcross(x[1], x[2], cross);
        sum += atan2(vdot(x[0], cross), r[0] * r[1] * r[2] + vdot(x[0], x[1]) * r[2] + vdot(x[1], x[2]) * r[0] +
                                            vdot(x[2], x[0]) * r[1]); /* half of the solid angle */
    }
    return fabs(sum) > PI; /* 0 outside, 2 pi inside, -2 pi where the body is inverted */
}

static double turn_of(const double a[2], const double b[2]) { return a[0] * b[1] - a[1] * b[0]; }

/* Counts how often each body's surface winds around a point: an upward ray leaves it so much more often than it enters.
 * Cheaper than solid angles, but a ray may meet an edge. */
static void count_winds(const tm_touching *t, const double p[3], int32_t *winds) {
    memset(winds, 0, sizeof *winds * TM_MAX_BODIES);
    for (int32_t i = 0; i < t->surface.face_count; i++) {
        double x[3], q[3][2], height[3];
        int32_t v[3];
        tm_touch_triangle(t, t->surface.face[i], v);
        for (int j = 0; j < 3; j++) { /* along a direction that no grid of vertices has */
            tm_touch_at(t->world, v[j], x);
            height[j] = x[2] - p[2];
            q[j][0] = x[0] - p[0] - 0.317 * height[j], q[j][1] = x[1] - p[1] - 0.171 * height[j];
        }
        const double a = turn_of(q[1], q[2]), b = turn_of(q[2], q[0]), c = turn_of(q[0], q[1]);
        const bool up = a >= 0 && b >= 0 && c >= 0, down = a < 0 && b < 0 && c < 0;
        if (!(up || down) || !((a * height[0] + b * height[1] + c * height[2]) / (a + b + c) > 0)) continue;
        winds[tm_touch_body(t, t->surface.face[i])] += up ? 1 : -1;
    }
}

bool tm_touch_is_outside(const tm_touching *t, const double p[3], int32_t body) {
    int32_t winds[TM_MAX_BODIES];
    count_winds(t, p, winds);
    return winds[body] == 0;
}

/* Returns a body whose surface winds around the vertex, or -1. */
static int32_t body_around(const tm_touching *t, int32_t vertex) {
    double p[3];
    int32_t winds[TM_MAX_BODIES];
    tm_touch_at(t->world, vertex, p);
    count_winds(t, p, winds);
    for (int32_t b = 0; b < t->def.body_count; b++)
        if (winds[b] != 0 && b != t->surface.body[vertex] && tm_touch_enabled(t, t->surface.body[vertex], b)) return b;
    return -1;
}

/* --- the list --- */

static bool is_listed(const tm_touching *t, int32_t vertex) {
    for (int32_t i = 0; i < t->inside_count; i++)
        if (t->inside[i].vertex == vertex) return true;
    return false;
}

void tm_touch_note_inside(tm_touching *t, const tm_touch_inside *inside) {
    int32_t at = t->found_count;
    while (at > 0 && t->found[at - 1].vertex > inside->vertex) at--;
    if (is_listed(t, inside->vertex) || t->found_count == TM_TOUCH_MAX_INSIDE) return;
    if (at > 0 && t->found[at - 1].vertex == inside->vertex) return;
    memmove(t->found + at + 1, t->found + at, sizeof *t->found * (size_t)(t->found_count - at));
    t->found[at] = *inside;
    t->found_count++;
}

/* Returns a face of a body. */
static int32_t face_of(const tm_touching *t, int32_t body) {
    for (int32_t i = 0; i < t->surface.face_count; i++)
        if (tm_touch_body(t, t->surface.face[i]) == body) return t->surface.face[i];
    return -1;
}

/* Returns whether a face is still on the surface; the list of these ascends. */
static bool is_on_surface(const tm_touching *t, int32_t face) {
    int32_t low = 0, high = t->surface.face_count;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (t->surface.face[middle] < face)
            low = middle + 1;
        else
            high = middle;
    }
    return low < t->surface.face_count && t->surface.face[low] == face;
}

static tm_touch_closest closest_on(const tm_touching *t, const double p[3], int32_t face) {
    double x[3][3];
    int32_t v[3];
    tm_touch_triangle(t, face, v);
    for (int j = 0; j < 3; j++) tm_touch_at(t->world, v[j], x[j]);
    return tm_touch_point_triangle(p, x[0], x[1], x[2]);
}

/* Finds the nearest face of the body of `inside->face`, of equally near ones the first. It is no farther than that
 * face; the clusters hold faces in places that may be half a margin off. */
static void find_nearest(tm_touching *t, tm_touch_inside *inside) {
    const int32_t body = tm_touch_body(t, inside->face), *face = t->surface.face;
    int32_t count = t->surface.face_count;
    double p[3];
    tm_touch_at(t->world, inside->vertex, p);
    inside->closest = closest_on(t, p, inside->face);
    if (!t->all_pairs && inside->closest.distance_m < INFINITY) {
        const tm_touch_bounds near = tm_touch_bounds_around(p, p, inside->closest.distance_m + tm_touch_misplaced_m(t));
        count = tm_touch_clusters_find(t->clusters + TM_TOUCH_FACES, &near, t->near_items), face = t->near_items;
    }
    for (int32_t i = 0; i < count; i++) {
        if (tm_touch_body(t, face[i]) != body) continue;
        const tm_touch_closest c = closest_on(t, p, face[i]);
        if (c.distance_m > inside->closest.distance_m) continue;
        if (c.distance_m == inside->closest.distance_m && face[i] > inside->face) continue;
        inside->closest = c, inside->face = face[i];
    }
}

/* Returns the substeps from check to check; those of suspects are halfway between. */
static int64_t period(const tm_touching *t) {
    return (int64_t)law_clamp((double)(t->surface.face_count / FACES), 1, PERIOD_MAX);
}

/* Lists a vertex from the next substep on, if it is inside, deeper than rows let it. */
static void check(tm_touching *t, int32_t vertex) {
    const int32_t body = is_listed(t, vertex) ? -1 : body_around(t, vertex);
    if (body < 0 || !is_wound(t, vertex, body, false) || is_wound(t, vertex, body, true)) return;
    tm_touch_inside inside = {.vertex = vertex, .face = face_of(t, body)};
    find_nearest(t, &inside);
    if (inside.closest.distance_m > DEEP * t->def.thickness_m) tm_touch_note_inside(t, &inside);
}

void tm_touch_suspect(tm_touching *t, int32_t vertex) {
    if (t->world->settling || t->world->state.step % period(t) != period(t) / 2) return;
    const uint32_t rank =
        ((uint32_t)vertex ^ (uint32_t)t->world->state.step) * 2654435761u; /* each comes first at times */
    if (t->suspect >= 0 && rank <= t->suspect_rank) return;
    t->suspect = vertex, t->suspect_rank = rank;
}

void tm_touch_check_suspect(tm_touching *t) {
    if (t->suspect >= 0) check(t, t->suspect);
}

/* --- the way out --- */

/* Returns whether the vertex is still inside; sets its nearest point, and whether it is pushed. */
static bool is_still_inside(tm_touching *t, tm_touch_inside *inside) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    double x[3][3];
    int32_t v[3];
    const int32_t body = tm_touch_body(t, inside->face);
    if (!is_on_surface(t, inside->face)) inside->face = face_of(t, body);
    if (inside->face < 0 || t->surface.body[inside->vertex] < 0) return false; /* cut */
    find_nearest(t, inside);
    if (!(inside->closest.distance_m > 0 && inside->closest.distance_m < INFINITY)) return false;
    tm_touch_triangle(t, inside->face, v);
    for (int j = 0; j < 3; j++) vset(mesh->rest_m + 3 * (int64_t)v[j], x[j]);
    inside->thickness_m =
        law_min(t->def.thickness_m,
                tm_touch_point_triangle(mesh->rest_m + 3 * (int64_t)inside->vertex, x[0], x[1], x[2]).distance_m);
    return is_wound(t, inside->vertex, body, false);
}

void tm_touch_find_inside(tm_touching *t) {
    t->inside_count = t->found_count = 0, t->suspect = -1;
    if (t->def.body_count < 2 || t->world->settling) return;
    int32_t end = t->memory_count;
    if (end > 0 && t->memory[end - 1].edges == TM_TOUCH_MEMORY_ACCOUNT) end--;
    int32_t first = end;
    while (first > 0 && t->memory[first - 1].edges == TM_TOUCH_MEMORY_INSIDE) first--;
    for (int32_t i = first; i < end && t->inside_count < TM_TOUCH_MAX_INSIDE; i++) {
        tm_touch_inside *inside = t->inside + t->inside_count;
        *inside = (tm_touch_inside){.vertex = t->memory[i].a, .face = t->memory[i].b};
        t->inside_count += is_still_inside(t, inside);
    }
    const int64_t turn = t->world->state.step / period(t);
    if (t->world->state.step % period(t) == 0 && t->surface.vertex_count > 0)
        check(t, t->surface.vertex[turn % t->surface.vertex_count]);
}

void tm_touch_remember_inside(tm_touching *t) {
    for (int32_t i = 0, k = 0; i < t->inside_count || k < t->found_count;) { /* ascending */
        const bool new = i == t->inside_count || (k < t->found_count && t->found[k].vertex < t->inside[i].vertex);
        const tm_touch_inside *one = new ? t->found + k++ : t->inside + i++;
        if (t->memory_count == t->def.max_rows) return;
        t->memory[t->memory_count++] =
            (tm_touch_memory){.edges = TM_TOUCH_MEMORY_INSIDE, .a = one->vertex, .b = one->face};
    }
}
