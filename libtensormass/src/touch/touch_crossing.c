/* Surfaces that would cross in this substep although their rows hold. A row is linear in the motion: what moves by more
 * than its own size in a substep may pass beside the face or edge that the row was for, and tissue that starts to move
 * may meet what was out of reach. So after some sweeps the paths of fast features are followed from the start of the
 * substep to its end as it is by then. Where a vertex enters a face, or an edge an edge, from outside, a row is added
 * with the weights and the normal of that moment, also between folds of one body.
 *
 * Tissue that was pushed through its own body is inside out: its rows push the wrong way, and other tissue comes from
 * behind. So where another body is behind a surface, slow features are followed too, against other bodies. A body is
 * then outside by its winding number, and edges meet where both pairs of faces lead away. Without a fast vertex and
 * without such a surface nothing is searched. */
#include "touch/touch_paths.h"

#include <math.h>

#include "base/vec.h"

/* Motion in a substep from which a vertex is fast, of the thickness. Of two slower ones, the pair is within reach. */
static const double FAST = 1;
/* How near the paths must come, of the thickness: between two neighbours no gap is left. */
static const double TOUCHING = 1e-4;
/* Sweeps before which paths are followed. */
enum { FIRST = 4, PERIOD = 2 };

/* --- paths --- */

static double motion2_of(const tm_touching *t, int32_t v) {
    double d[3];
    tm_touch_motion(t, v, d);
    return vdot(d, d);
}

static bool has_fast(const tm_touching *t, const int32_t *vertex, int count) {
    bool fast = false;
    for (int j = 0; j < count && !fast; j++) fast = t->is_fast[vertex[j]];
    return fast;
}

static tm_touch_box box_of_paths(const tm_touching *t, const int32_t *vertex, int count) {
    tm_touch_box box = tm_touch_no_box();
    for (int k = 0; k < count; k++) {
        double from[3], to[3];
        tm_touch_ends(t, vertex[k], from, to);
        tm_touch_box_add(&box, from);
        tm_touch_box_add(&box, to);
    }
    return box;
}

/* --- a vertex and a face --- */

static bool is_of_two_bodies(const tm_touching *t, const tm_touch_pair *pair) {
    return t->surface.body[pair->a] != tm_touch_body(t, pair->b);
}

/* Sets the row of a vertex that meets a face at a share of the substep; `side`: of the face on which it was. Returns
 * false if it only seems to. */
static bool meet_face(const tm_touching *t, const tm_touch_pair *pair, const int32_t w[3], double share, double side,
                      tm_touching_row *row) {
    double x[4][3], ab[3], ac[3];
    tm_touch_place_at(t, pair->a, share, x[3]);
    for (int j = 0; j < 3; j++) tm_touch_place_at(t, w[j], share, x[j]);
    const tm_touch_closest closest = tm_touch_point_triangle(x[3], x[0], x[1], x[2]);
    if (!(closest.distance_m <= TOUCHING * t->def.thickness_m)) return false;
    *row = (tm_touching_row){.a = pair->a, .b = pair->b, .thickness_m = pair->thickness_m};
    row->vertex[0] = pair->a, row->weight[0] = 1;
    for (int j = 0; j < 3; j++) row->vertex[1 + j] = w[j], row->weight[1 + j] = -closest.weight[j];
    vsub(x[1], x[0], ab);
    vsub(x[2], x[0], ac);
    vcross(ab, ac, row->normal);
    const bool is_one = vunit(row->normal, row->normal) > 0;
    vscale(side, row->normal, row->normal);
    return is_one;
}

/* Returns whether a vertex enters a face from outside; sets its row. Tissue that was pushed through its own body is
 * inside out: there a face of another body is also entered from behind, by a vertex that is outside that body. A slow
 * vertex must be outside in any case: bodies that overlap may slide. */
static bool enters_face(const tm_touching *t, const tm_touch_pair *pair, tm_touching_row *row) {
    int32_t w[3];
    double c[4], end[4], from[3];
    tm_touch_triangle(t, pair->b, w);
    tm_touch_volume(t, (int32_t[]){w[0], w[1], w[2], pair->a}, c);
    const int parts = tm_touch_volume_parts(c, end);
    for (int i = 0; i < parts; i++) {
        const bool front = tm_touch_volume_at(c, end[i]) > 0;
        if (front == (tm_touch_volume_at(c, end[i + 1]) > 0) || !(front || is_of_two_bodies(t, pair))) continue;
        if (!meet_face(t, pair, w, tm_touch_volume_root(c, end[i], end[i + 1]), front ? 1 : -1, row)) continue;
        tm_touch_place_at(t, pair->a, 0, from);
        if ((front && has_fast(t, row->vertex, 4)) || tm_touch_is_outside(t, from, tm_touch_body(t, pair->b)))
            return true;
    }
    return false;
}

/* --- two edges --- */

static void normal_at(const tm_touching *t, int32_t face, double share, double n[3]) {
    int32_t v[3];
    double x[3][3];
    tm_touch_triangle(t, face, v);
    for (int j = 0; j < 3; j++) tm_touch_place_at(t, v[j], share, x[j]);
    vsub(x[1], x[0], x[1]);
    vsub(x[2], x[0], x[2]);
    vcross(x[1], x[2], n);
    vunit(n, n);
}

/* Computes the sum of the normals of an edge's faces at a share of the substep. Returns whether the edge sticks out. */
static bool sticks_out(const tm_touching *t, int32_t edge, double share, double n[3]) {
    const int32_t *of = t->surface.of_edge + 2 * (int64_t)edge,
                  *ends = t->world->tissue->mesh->edge + 2 * (int64_t)edge;
    int32_t v[3], across = ends[0];
    double first[3], second[3], from[3], to[3];
    normal_at(t, of[0], share, first);
    normal_at(t, of[1], share, second);
    vset(first, n);
    vmadd(n, 1, second, n);
    tm_touch_triangle(t, of[1], v);
    for (int j = 0; j < 3; j++)
        if (v[j] != ends[0] && v[j] != ends[1]) across = v[j];
    tm_touch_place_at(t, ends[0], share, from);
    tm_touch_place_at(t, across, share, to);
    vsub(to, from, to);
    return vdot(to, first) < 0;
}

/* Returns whether both faces of an edge lead away from a point of it, along a direction. */
static bool leads_along(const tm_touching *t, int32_t edge, double share, const double from[3], const double n[3]) {
    const int32_t *ends = t->world->tissue->mesh->edge + 2 * (int64_t)edge;
    bool along = true;
    for (int k = 0; k < 2; k++) {
        int32_t v[3];
        double x[3];
        tm_touch_triangle(t, t->surface.of_edge[2 * (int64_t)edge + k], v);
        for (int j = 0; j < 3; j++) {
            if (v[j] == ends[0] || v[j] == ends[1]) continue;
            tm_touch_place_at(t, v[j], share, x);
            vsub(x, from, x);
            along &= vdot(x, n) > 0;
        }
    }
    return along;
}

/* Returns whether the edges of a row are of two bodies that are apart there: both pairs of faces lead away from the
 * other edge, and before, neither place was in the other body. Holds where tissue is inside out, too. */
static bool were_apart(const tm_touching *t, const tm_touching_row *row, double share) {
    const int32_t *v = row->vertex, body[2] = {t->surface.body[v[0]], t->surface.body[v[2]]};
    double at[3] = {0, 0, 0}, back[3], x[3];
    if (body[0] == body[1]) return false;
    for (int j = 0; j < 2; j++) tm_touch_place_at(t, v[j], share, x), vmadd(at, -row->weight[j], x, at);
    vscale(-1, row->normal, back);
    if (!leads_along(t, row->a, share, at, back) || !leads_along(t, row->b, share, at, row->normal)) return false;
    for (int k = 0; k < 2; k++) {
        vset((const double[3]){0, 0, 0}, at);
        for (int j = 2 * k; j < 2 * k + 2; j++)
            tm_touch_place_at(t, v[j], 0, x), vmadd(at, fabs(row->weight[j]), x, at);
        if (!tm_touch_is_outside(t, at, body[!k])) return false;
    }
    return true;
}

/* Sets the row of two edges that meet at a share of the substep. `sign`: of the volume before. Returns false if they
 * only seem to, or one leaves the other's tissue. Slow ones must have been apart. */
static bool meet(const tm_touching *t, const tm_touch_pair *pair, const int32_t v[4], double share, double sign,
                 tm_touching_row *row) {
    double x[4][3], da[3], db[3], na[3], nb[3], s, r;
    bool inside;
    for (int j = 0; j < 4; j++) tm_touch_place_at(t, v[j], share, x[j]);
    if (!(tm_touch_segments(x[0], x[1], x[2], x[3], &s, &r, &inside) <= TOUCHING * t->def.thickness_m)) return false;
    if (!inside) return false;
    *row = (tm_touching_row){.edges = 1,
                             .a = pair->a,
                             .b = pair->b,
                             .vertex = {v[0], v[1], v[2], v[3]},
                             .weight = {-(1 - s), -s, 1 - r, r},
                             .thickness_m = pair->thickness_m};
    vsub(x[1], x[0], da);
    vsub(x[3], x[2], db);
    vcross(da, db, row->normal);
    vunit(row->normal, row->normal);
    vscale(sign, row->normal, row->normal); /* from the first to the second, before they met */
    const bool stick_out = sticks_out(t, pair->a, share, na) & sticks_out(t, pair->b, share, nb) && has_fast(t, v, 4);
    return (stick_out && vdot(row->normal, na) > 0 && vdot(row->normal, nb) < 0) || were_apart(t, row, share);
}

/* Returns whether two edges enter each other's tissue; sets their row. */
static bool edges_enter(const tm_touching *t, const tm_touch_pair *pair, tm_touching_row *row) {
    const int32_t *va = t->world->tissue->mesh->edge + 2 * (int64_t)pair->a,
                  *vb = t->world->tissue->mesh->edge + 2 * (int64_t)pair->b, v[4] = {va[0], va[1], vb[0], vb[1]};
    double c[4], end[4];
    tm_touch_volume(t, v, c); /* (a1 - a0) x (b0 - a0) . (b1 - a0) = -(da x db) . (b0 - a0) */
    const int parts = tm_touch_volume_parts(c, end);
    for (int i = 0; i < parts; i++) {
        const bool positive = tm_touch_volume_at(c, end[i]) > 0;
        if (positive == (tm_touch_volume_at(c, end[i + 1]) > 0)) continue;
        if (meet(t, pair, v, tm_touch_volume_root(c, end[i], end[i + 1]), positive ? -1 : 1, row)) return true;
    }
    return false;
}

/* --- search --- */

/* Lists a pair whose paths overlap, if it changes sides and may touch: a vertex and a face, or the lower edge and the
 * other. */
static void list_pair(const tm_touching *t, int kind, int32_t item, int32_t other, tm_touch_list *to) {
    const bool turned = kind == TM_TOUCH_EDGES ? item > other : kind == TM_TOUCH_FACES;
    const int32_t a = turned ? other : item, b = turned ? item : other;
    tm_touch_pair pair;
    double cubic[4];
    int32_t v[4];
    if (kind == TM_TOUCH_EDGES)
        for (int k = 0; k < 4; k++) v[k] = t->world->tissue->mesh->edge[2 * (int64_t)(k < 2 ? a : b) + k % 2];
    else
        tm_touch_triangle(t, b, v), v[3] = a;
    if (v[3] == v[0] || v[3] == v[1] || v[3] == v[2] || v[2] == v[0] || v[2] == v[1]) return; /* neighbours */
    tm_touch_volume(t, v, cubic);
    if (!tm_touch_volume_crosses(cubic)) return;
    const bool may =
        kind == TM_TOUCH_EDGES ? tm_touch_may_touch_edges(t, a, b, &pair) : tm_touch_may_touch_face(t, a, b, &pair);
    if (!may) return;
    if (to->count == to->room)
        to->overflowed = true;
    else
        to->pair[to->count++] = pair;
}

enum { TOGETHER = 16 };

/* The path of a feature that is followed. If it is not fast, only against other bodies. */
typedef struct path {
    tm_touch_box box;
    int32_t body;
    bool fast;
} path;

/* Computes the paths of `count` features, neighbours for the most part. Returns a box around all that is in their way
 * and not faster, in places of the clusters. */
static tm_touch_box box_of_way(const tm_touching *t, int kind, const int32_t *item, int count, path of[TOGETHER]) {
    tm_touch_box way = tm_touch_no_box();
    const double slow_m = t->frames_motion_m + FAST * t->def.thickness_m; /* at most, of what has no search */
    for (int i = 0; i < count; i++) {
        int32_t v[3];
        double motion2 = 0;
        const int vertices = tm_touch_vertices(t, kind, item[i], v);
        for (int j = 0; j < vertices; j++) motion2 = law_max(motion2, motion2_of(t, v[j]));
        of[i] = (path){box_of_paths(t, v, vertices), t->surface.body[v[0]], has_fast(t, v, vertices)};
        const double grow_m = tm_touch_misplaced_m(t) + law_max(sqrt(motion2), slow_m);
        for (int c = 0; c < 3; c++) {
            way.low[c] = law_min(way.low[c], of[i].box.low[c] - grow_m);
            way.high[c] = law_max(way.high[c], of[i].box.high[c] + grow_m);
        }
    }
    return way;
}

/* Lists the pairs of some followed features with those that are not faster. */
static void search(const tm_touching *t, int kind, int against, const int32_t *item, int count, int32_t *found,
                   tm_touch_list *to) {
    const tm_touch_surface *s = &t->surface;
    int32_t all = against == TM_TOUCH_FACES   ? s->face_count
                  : against == TM_TOUCH_EDGES ? s->edge_count
                                              : s->vertex_count;
    const int32_t *of = against == TM_TOUCH_FACES ? s->face : against == TM_TOUCH_EDGES ? s->edge : s->vertex;
    path mine[TOGETHER];
    const tm_touch_box way = box_of_way(t, kind, item, count, mine);
    if (!t->all_pairs) {
        const tm_touch_bounds near = tm_touch_bounds_around(way.low, way.high, 0);
        all = tm_touch_clusters_find(t->clusters + against, &near, found), of = found;
    }
    for (int32_t k = 0; k < all; k++) {
        int32_t v[3];
        const int vertices = tm_touch_vertices(t, against, of[k], v);
        const tm_touch_box its = box_of_paths(t, v, vertices);
        for (int i = 0; i < count; i++)
            if (tm_touch_boxes_overlap(&mine[i].box, &its) && (mine[i].fast || mine[i].body != t->surface.body[v[0]]))
                list_pair(t, kind, item[i], of[k], to);
    }
}

/* --- rows --- */

static void add_row(tm_touching *t, tm_touching_row *row) {
    double from[3] = {0, 0, 0};
    for (int j = 0; j < 4; j++) {
        double x[3];
        tm_touch_place_at(t, row->vertex[j], 0, x);
        vmadd(from, row->weight[j], x, from);
    }
    row->gap_m = vdot(row->normal, from) - row->thickness_m;
    if (tm_touch_add_row(t, row, t->def.compliance_m_N)) tm_touch_prepare_row(t, t->row_count - 1);
}

static bool is_quick(const tm_touching *t, int32_t v) { return t->is_fast[v] || t->is_followed[v]; }

/* Returns whether a vertex is fast by now, or followed in any case: tools push them, so the integrator's bound does not
 * hold. */
static bool has_quick(const tm_touching *t) {
    const double limit2 = FAST * FAST * t->def.thickness_m * t->def.thickness_m;
    double most2 = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) most2 = law_max(most2, motion2_of(t, t->surface.vertex[i]));
    return most2 > limit2 || t->followed_count > 0;
}

static bool list_quick(tm_touching *t) {
    if (!has_quick(t)) return false;
    tm_touch_find_frames(t, FAST * t->def.thickness_m);
    return tm_touch_list_quick(t, is_quick);
}

/* Lists a part of the pairs of fast features of a kind with those of another. */
static void search_kind(tm_touching *t, int kind, int against, int32_t part, int32_t parts, tm_touch_list *to) {
    const tm_touch_set *quick = t->quick + kind;
    int32_t *found = t->near_items + (int64_t)t->most_items * part;
    const int32_t share = quick->count / parts + 1, size = share < TOGETHER ? share : TOGETHER;
    for (int32_t i = size * part, left; (left = quick->count - i) > 0; i += size * parts)
        search(t, kind, against, quick->list + i, left < size ? left : size, found, to);
}

static void search_part(tm_touching *t, int32_t part, int32_t parts, tm_touch_lists *to) {
    search_kind(t, TM_TOUCH_VERTICES, TM_TOUCH_FACES, part, parts, &to->vf);
    search_kind(t, TM_TOUCH_FACES, TM_TOUCH_VERTICES, part, parts, &to->vf);
    search_kind(t, TM_TOUCH_EDGES, TM_TOUCH_EDGES, part, parts, &to->ee);
}

/* Lists the pairs of fast features. */
static void search_fast(tm_touching *t) {
    tm_touch_lists *to = &t->fast;
    to->vf.count = to->ee.count = 0;
    if (t->quick[TM_TOUCH_EDGES].count > TOGETHER)
        tm_touch_divide(t, search_part, to);
    else
        search_part(t, 0, 1, to);
    t->report.overflowed |= to->vf.overflowed || to->ee.overflowed;
    tm_touch_list_merge(&to->vf, 0, t->scratch);
    tm_touch_list_drop_doubles(&to->vf);
    tm_touch_list_merge(&to->ee, 0, t->scratch);
    tm_touch_list_drop_doubles(&to->ee);
}

/* Adds rows of what would cross; returns whether anything would. */
static bool stop_crossings(tm_touching *t) {
    tm_touching_row row;
    const int32_t before = t->row_count;
    t->may_cross = t->may_cross && list_quick(t);
    if (!t->may_cross) return false;
    search_fast(t);
    for (int32_t i = 0; i < t->fast.vf.count; i++)
        if (enters_face(t, t->fast.vf.pair + i, &row)) add_row(t, &row);
    for (int32_t i = 0; i < t->fast.ee.count; i++)
        if (edges_enter(t, t->fast.ee.pair + i, &row)) add_row(t, &row);
    return t->row_count > before;
}

/* Adds rows of what would cross, and sweeps until these agree. Returns whether anything would. */
static bool sweep_crossings(tm_touching *t) {
    enum { MORE = 10 };
    const bool crossed = stop_crossings(t);
    for (int32_t k = 0; crossed && k < MORE; k++) tm_touch_sweep_once(t, k);
    return crossed;
}

void tm_touch_sweep(tm_touching *t, int32_t sweep) {
    if (sweep == FIRST) t->may_cross = !t->world->settling;
    if (sweep >= FIRST && sweep % PERIOD == FIRST % PERIOD) sweep_crossings(t);
    tm_touch_sweep_once(t, sweep);
}

void tm_touch_sweep_last(tm_touching *t) {
    enum { ROUNDS = 4 };
    for (int32_t k = 0; k < ROUNDS && t->may_cross && sweep_crossings(t); k++) {
    }
}

void tm_touch_list_entered(tm_touching *t) {
    if (!t->may_cross || t->def.body_count < 2) return;
    t->may_cross = false;
    list_quick(t);
    search_fast(t);
    for (int32_t i = 0; i < t->fast.vf.count; i++) {
        const tm_touch_pair *pair = t->fast.vf.pair + i;
        tm_touching_row row;
        if (t->surface.body[pair->a] != tm_touch_body(t, pair->b) && enters_face(t, pair, &row))
            tm_touch_note_inside(t, &(tm_touch_inside){.vertex = pair->a, .face = pair->b});
    }
}
