/* Surfaces that would cross in this substep although their rows hold. A row is linear in the motion: what moves by more
 * than its own size in a substep may pass beside the face or edge that the row was for, and tissue that starts to move
 * may meet what was out of reach. So after some sweeps the paths of fast features are followed from the start of the
 * substep to its end as it is by then. Where a vertex enters a face, or an edge an edge, from outside, a row is added
 * with the weights and the normal of that moment, also between folds of one body. Without a fast vertex nothing is
 * searched. */
#include "touch/touch_internal.h"

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
    vsub(t->world->state.u_next_m + 3 * (int64_t)v, t->world->state.u_m + 3 * (int64_t)v, d);
    return vdot(d, d);
}

/* Computes the place of a vertex at a share of the substep. */
static void place_at(const tm_touching *t, int32_t v, double share, double x[3]) {
    const tm_state *state = &t->world->state;
    for (int c = 0; c < 3; c++) {
        const int64_t d = 3 * (int64_t)v + c;
        x[c] = t->world->tissue->mesh->rest_m[d] + state->u_m[d] + share * (state->u_next_m[d] - state->u_m[d]);
    }
}

static tm_touch_box box_of_paths(const tm_touching *t, const int32_t *vertex, int count) {
    tm_touch_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int k = 0; k < 2 * count; k++) {
        double x[3];
        place_at(t, vertex[k / 2], k % 2, x);
        for (int c = 0; c < 3; c++) box.low[c] = law_min(box.low[c], x[c]), box.high[c] = law_max(box.high[c], x[c]);
    }
    return box;
}

static bool boxes_overlap(const tm_touch_box *a, const tm_touch_box *b) {
    bool overlap = true;
    for (int c = 0; c < 3; c++) overlap &= a->low[c] <= b->high[c] && b->low[c] <= a->high[c];
    return overlap;
}

static double determinant(const double a[3], const double b[3], const double c[3]) {
    double cross[3];
    vcross(a, b, cross);
    return vdot(cross, c);
}

/* Computes the cubic in the share of the substep of the volume between four vertices: that of the vectors from the
 * first to the others. */
static void volume_of(const tm_touching *t, const int32_t vertex[4], double cubic[4]) {
    double e[3][3], d[3][3], from[2][3];
    for (int k = 0; k < 2; k++) place_at(t, vertex[0], k, from[k]);
    for (int j = 0; j < 3; j++) {
        double to[3];
        place_at(t, vertex[1 + j], 0, to);
        vsub(to, from[0], e[j]);
        place_at(t, vertex[1 + j], 1, to);
        vsub(to, from[1], d[j]);
        vsub(d[j], e[j], d[j]);
    }
    cubic[0] = determinant(e[0], e[1], e[2]);
    cubic[1] = determinant(d[0], e[1], e[2]) + determinant(e[0], d[1], e[2]) + determinant(e[0], e[1], d[2]);
    cubic[2] = determinant(d[0], d[1], e[2]) + determinant(d[0], e[1], d[2]) + determinant(e[0], d[1], d[2]);
    cubic[3] = determinant(d[0], d[1], d[2]);
}

static double value(const double c[4], double x) { return ((c[3] * x + c[2]) * x + c[1]) * x + c[0]; }

/* Stores the ends of the parts of [0, 1] in which the cubic ascends or descends. Returns the count of parts. */
static int divide(const double c[4], double end[4]) {
    const double a = 3 * c[3], half = c[2], root2 = half * half - a * c[1];
    int count = 0;
    end[0] = 0;
    if (root2 > 0) {
        const double q = -(half + copysign(sqrt(root2), half)), one = a != 0 ? q / a : -1, two = q != 0 ? c[1] / q : -1;
        const double low = law_min(one, two), high = law_max(one, two);
        if (low > 0 && low < 1) end[++count] = low;
        if (high > 0 && high < 1) end[++count] = high;
    }
    end[++count] = 1;
    return count;
}

/* Returns where the cubic changes its sign between two places. */
static double root_between(const double c[4], double low, double high) {
    const bool from_positive = value(c, low) > 0;
    for (int i = 0; i < 50; i++) {
        const double middle = 0.5 * (low + high);
        *((value(c, middle) > 0) == from_positive ? &low : &high) = middle;
    }
    return 0.5 * (low + high);
}

/* --- a vertex and a face --- */

/* Returns whether a vertex enters a face from outside; sets its row. */
static bool enters_face(const tm_touching *t, const tm_touch_pair *pair, tm_touching_row *row) {
    int32_t w[3];
    double c[4], end[4];
    tm_touch_triangle(t, pair->b, w);
    volume_of(t, (int32_t[]){w[0], w[1], w[2], pair->a}, c);
    const int parts = divide(c, end);
    for (int i = 0; i < parts; i++) {
        if (!(value(c, end[i]) > 0 && value(c, end[i + 1]) <= 0)) continue;
        const double share = root_between(c, end[i], end[i + 1]);
        double x[4][3], ab[3], ac[3];
        place_at(t, pair->a, share, x[3]);
        for (int j = 0; j < 3; j++) place_at(t, w[j], share, x[j]);
        const tm_touch_closest closest = tm_touch_point_triangle(x[3], x[0], x[1], x[2]);
        if (!(closest.distance_m <= TOUCHING * t->def.thickness_m)) continue;
        *row = (tm_touching_row){.a = pair->a, .b = pair->b, .thickness_m = pair->thickness_m};
        row->vertex[0] = pair->a, row->weight[0] = 1;
        for (int j = 0; j < 3; j++) row->vertex[1 + j] = w[j], row->weight[1 + j] = -closest.weight[j];
        vsub(x[1], x[0], ab);
        vsub(x[2], x[0], ac);
        vcross(ab, ac, row->normal);
        return vunit(row->normal, row->normal) > 0;
    }
    return false;
}

/* --- two edges --- */

static void normal_at(const tm_touching *t, int32_t face, double share, double n[3]) {
    int32_t v[3];
    double x[3][3];
    tm_touch_triangle(t, face, v);
    for (int j = 0; j < 3; j++) place_at(t, v[j], share, x[j]);
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
    place_at(t, ends[0], share, from);
    place_at(t, across, share, to);
    vsub(to, from, to);
    return vdot(to, first) < 0;
}

/* Sets the row of two edges that meet at a share of the substep. `sign`: of the volume before. Returns false if they
 * only seem to, or one leaves the other's tissue. */
static bool meet(const tm_touching *t, const tm_touch_pair *pair, const int32_t v[4], double share, double sign,
                 tm_touching_row *row) {
    double x[4][3], da[3], db[3], na[3], nb[3], s, r;
    bool inside;
    for (int j = 0; j < 4; j++) place_at(t, v[j], share, x[j]);
    if (!(tm_touch_segments(x[0], x[1], x[2], x[3], &s, &r, &inside) <= TOUCHING * t->def.thickness_m)) return false;
    if (!inside || !sticks_out(t, pair->a, share, na) || !sticks_out(t, pair->b, share, nb)) return false;
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
    return vdot(row->normal, na) > 0 && vdot(row->normal, nb) < 0;
}

/* Returns whether two edges enter each other's tissue; sets their row. */
static bool edges_enter(const tm_touching *t, const tm_touch_pair *pair, tm_touching_row *row) {
    const int32_t *va = t->world->tissue->mesh->edge + 2 * (int64_t)pair->a,
                  *vb = t->world->tissue->mesh->edge + 2 * (int64_t)pair->b, v[4] = {va[0], va[1], vb[0], vb[1]};
    double c[4], end[4];
    volume_of(t, v, c); /* (a1 - a0) x (b0 - a0) . (b1 - a0) = -(da x db) . (b0 - a0) */
    const int parts = divide(c, end);
    for (int i = 0; i < parts; i++) {
        const bool positive = value(c, end[i]) > 0;
        if (positive == (value(c, end[i + 1]) > 0)) continue;
        if (meet(t, pair, v, root_between(c, end[i], end[i + 1]), positive ? -1 : 1, row)) return true;
    }
    return false;
}

/* --- search --- */

/* Lists a pair whose paths overlap, if it may touch. */
static void list_pair(const tm_touching *t, int kind, int32_t item, int32_t other, tm_touch_list *to) {
    tm_touch_pair pair;
    const bool may = kind == TM_TOUCH_EDGES
                         ? tm_touch_may_touch_edges(t, item < other ? item : other, item < other ? other : item, &pair)
                         : tm_touch_may_touch_face(t, kind == TM_TOUCH_VERTICES ? item : other,
                                                   kind == TM_TOUCH_VERTICES ? other : item, &pair);
    if (!may) return;
    if (to->count == to->room)
        to->overflowed = true;
    else
        to->pair[to->count++] = pair;
}

enum { TOGETHER = 16 };

/* Computes the boxes of the paths of `count` fast features, neighbours for the most part. Returns a box around all that
 * is in their way and not faster, in places of the clusters. */
static tm_touch_box box_of_way(const tm_touching *t, int kind, const int32_t *item, int count,
                               tm_touch_box box[TOGETHER]) {
    tm_touch_box way = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int i = 0; i < count; i++) {
        int32_t v[3];
        double motion2 = 0;
        const int vertices = tm_touch_vertices(t, kind, item[i], v);
        for (int j = 0; j < vertices; j++) motion2 = law_max(motion2, motion2_of(t, v[j]));
        box[i] = box_of_paths(t, v, vertices);
        const double grow_m = tm_touch_misplaced_m(t) + sqrt(motion2);
        for (int c = 0; c < 3; c++) {
            way.low[c] = law_min(way.low[c], box[i].low[c] - grow_m);
            way.high[c] = law_max(way.high[c], box[i].high[c] + grow_m);
        }
    }
    return way;
}

/* Lists the pairs of some fast features with those that are not faster. */
static void search(const tm_touching *t, int kind, int against, const int32_t *item, int count, int32_t *found,
                   tm_touch_list *to) {
    const tm_touch_surface *s = &t->surface;
    int32_t all = against == TM_TOUCH_FACES   ? s->face_count
                  : against == TM_TOUCH_EDGES ? s->edge_count
                                              : s->vertex_count;
    const int32_t *of = against == TM_TOUCH_FACES ? s->face : against == TM_TOUCH_EDGES ? s->edge : s->vertex;
    tm_touch_box box[TOGETHER];
    const tm_touch_box way = box_of_way(t, kind, item, count, box);
    if (!t->all_pairs) {
        const tm_touch_bounds near = tm_touch_bounds_around(way.low, way.high, 0);
        all = tm_touch_clusters_find(t->clusters + against, &near, found), of = found;
    }
    for (int32_t k = 0; k < all; k++) {
        int32_t v[3];
        const int vertices = tm_touch_vertices(t, against, of[k], v);
        const tm_touch_box its = box_of_paths(t, v, vertices);
        for (int i = 0; i < count; i++)
            if (boxes_overlap(box + i, &its)) list_pair(t, kind, item[i], of[k], to);
    }
}

/* --- rows --- */

static void add_row(tm_touching *t, tm_touching_row *row) {
    double from[3] = {0, 0, 0};
    for (int j = 0; j < 4; j++) {
        double x[3];
        place_at(t, row->vertex[j], 0, x);
        vmadd(from, row->weight[j], x, from);
    }
    row->gap_m = vdot(row->normal, from) - row->thickness_m;
    if (tm_touch_add_row(t, row, t->def.compliance_m_N)) tm_touch_prepare_row(t, t->row_count - 1);
}

/* Lists the features that are fast by now: tools push them, so the integrator's bound does not hold. */
static bool list_fast(tm_touching *t) {
    const tm_state *state = &t->world->state;
    return tm_touch_list_quick(t, state->u_next_m, state->u_m, FAST * t->def.thickness_m);
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
static bool stop_crossings(tm_touching *t, int32_t sweep) {
    tm_touching_row row;
    const int32_t before = t->row_count;
    if (t->world->settling || sweep < FIRST || sweep % PERIOD != FIRST % PERIOD) return false;
    t->may_cross = (sweep == FIRST || t->may_cross) && list_fast(t);
    if (!t->may_cross) return false;
    search_fast(t);
    for (int32_t i = 0; i < t->fast.vf.count; i++)
        if (enters_face(t, t->fast.vf.pair + i, &row)) add_row(t, &row);
    for (int32_t i = 0; i < t->fast.ee.count; i++)
        if (edges_enter(t, t->fast.ee.pair + i, &row)) add_row(t, &row);
    return t->row_count > before;
}

/* Bodies that meet fast take more sweeps until their rows agree. */
void tm_touch_sweep(tm_touching *t, int32_t sweep) {
    enum { MORE = 10 };
    const bool crossed = stop_crossings(t, sweep);
    for (int32_t k = 0; crossed && k < MORE; k++) tm_touch_sweep_once(t, k);
    tm_touch_sweep_once(t, sweep);
}

void tm_touch_list_entered(tm_touching *t) {
    if (!t->may_cross || t->def.body_count < 2) return;
    t->may_cross = false;
    list_fast(t);
    search_fast(t);
    for (int32_t i = 0; i < t->fast.vf.count; i++) {
        const tm_touch_pair *pair = t->fast.vf.pair + i;
        tm_touching_row row;
        if (t->surface.body[pair->a] != tm_touch_body(t, pair->b) && enters_face(t, pair, &row))
            tm_touch_note_inside(t, &(tm_touch_inside){.vertex = pair->a, .face = pair->b});
    }
}
