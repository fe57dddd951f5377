/* Narrow phase: the rows of a substep, from the pairs that are awake. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "contact_law/compliance.h"

/* Folds from 0 to 14 degrees: an edge counts as far as it sticks out. */
static const double FOLD = 1 - 0.9703;

/* --- ranges --- */

/* A pair within its thickness and this distance gets a row: what it may approach in a substep. Twice the pair's own
 * relative motion in the last substep, and a quarter of a thickness. Pairs of the lists are within reach, which is a
 * thickness more than theirs. */
static double lookahead_m(const tm_touching *t, const tm_touching_row *row) {
    const tm_state *state = &t->world->state;
    double moved[3] = {0, 0, 0};
    for (int j = 0; j < 4; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * row->vertex[j] + c;
            moved[c] += row->weight[j] * (state->u_m[d] - state->u_prev_m[d]);
        }
    return 0.25 * t->def.thickness_m + 2 * vnorm(moved);
}

static bool is_asleep(const tm_touching *t, const tm_touch_pair *pair) { return pair->wake_m > t->odometer_m; }

/* Lets the pair sleep until the odometer says that it may be in reach. */
static void send_to_sleep(const tm_touching *t, tm_touch_pair *pair, double distance_m) {
    pair->wake_m = t->odometer_m + distance_m - pair->thickness_m - t->def.thickness_m;
}

static void normal_of(const tm_touching *t, int32_t f, double n[3]) {
    double x[3][3], ab[3], ac[3];
    int32_t v[3];
    tm_touch_triangle(t, f, v);
    for (int j = 0; j < 3; j++) tm_touch_at(t->world, v[j], x[j]);
    vsub(x[1], x[0], ab);
    vsub(x[2], x[0], ac);
    vcross(ab, ac, n);
    vunit(n, n);
}

/* Returns whether the tetrahedron of a face is inverted: its normal then points into the tissue. */
static bool is_inverted(const tm_touching *t, int32_t face, const double n[3]) {
    int32_t v[3];
    double on[3], within[3];
    tm_touch_triangle(t, face, v);
    tm_touch_at(t->world, v[0], on);
    tm_touch_at(t->world, t->world->tissue->mesh->tet[face], within);
    vsub(within, on, within);
    return vdot(within, n) >= 0;
}

bool tm_touch_add_row(tm_touching *t, const tm_touching_row *row, double compliance_m_N) {
    if (t->row_count == t->def.max_rows) {
        t->report.overflowed = true;
        return false;
    }
    t->row[t->row_count] = *row;
    t->solver[t->row_count++] = (tm_touch_solver){
        .compliance_m_N = compliance_m_N, .gap_m = row->gap_m, .soft_m = LAW_COMPLIANCE_TRAVEL * row->thickness_m};
    return true;
}

/* --- overlaps --- */

static bool share_a_vertex(const tm_touching *t, int32_t edges, int32_t b, int32_t c) {
    const int32_t *end = t->world->tissue->mesh->edge;
    int32_t v[3], w[3], shared = 0;
    if (edges)
        return end[2 * b] == end[2 * c] || end[2 * b] == end[2 * c + 1] || end[2 * b + 1] == end[2 * c] ||
               end[2 * b + 1] == end[2 * c + 1];
    tm_touch_triangle(t, b, v);
    tm_touch_triangle(t, c, w);
    for (int j = 0; j < 3; j++) shared += v[j] == w[0] || v[j] == w[1] || v[j] == w[2];
    return shared > 0;
}

/* Returns whether two features that overlap have tissue between them that is crushed: at rest one is behind the other,
 * and in the last substep no row there kept them apart. They did not pass through each other then. */
static bool are_crushed(const tm_touching *t, int32_t edges, const tm_touch_pair *pair) {
    int32_t low = 0, high = pair->through ? t->memory_count : 0;
    while (low < high) { /* sorted by edges, a, b */
        const int32_t middle = low + (high - low) / 2;
        const tm_touch_memory *m = t->memory + middle;
        if (m->edges < edges || (m->edges == edges && m->a < pair->a))
            low = middle + 1;
        else
            high = middle;
    }
    for (; pair->through && low < t->memory_count; low++) {
        const tm_touch_memory *m = t->memory + low;
        if (m->edges != edges || m->a != pair->a) break;
        if (share_a_vertex(t, edges, m->b, pair->b)) return false;
    }
    return pair->through;
}

/* --- vertices against faces --- */

/* Returns the unit normal of the surface at a vertex, from the fan of its first tetrahedra's faces: for vertices that
 * have passed a face, which are few. */
static void vertex_normal(const tm_touching *t, int32_t v, double n[3]) {
    const tm_tissue *tissue = t->world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    memset(n, 0, 3 * sizeof(double));
    for (int32_t e = mesh->vertex_edge_begin[v]; e < mesh->vertex_edge_begin[v + 1]; e++)
        for (int k = 0; k < 2; k++) {
            double one[3];
            const int32_t f = t->surface.of_edge[2 * (int64_t)mesh->vertex_edge[e] + k];
            if (f < 0) continue;
            normal_of(t, f, one);
            vmadd(n, 1, one, n);
        }
    vunit(n, n);
}

static void set_vertex_face(const tm_touching *t, const tm_touch_pair *pair, const tm_touch_closest *c,
                            const double n[3], double signed_m, tm_touching_row *row) {
    *row = (tm_touching_row){.a = pair->a, .b = pair->b, .thickness_m = pair->thickness_m};
    row->gap_m = signed_m - pair->thickness_m;
    row->vertex[0] = pair->a, row->weight[0] = 1;
    tm_touch_triangle(t, pair->b, row->vertex + 1);
    for (int j = 0; j < 3; j++) row->weight[1 + j] = -c->weight[j];
    vset(n, row->normal);
}

/* Of the pairs of one vertex: rows on faces over which it is, and the nearest edge or vertex. */
typedef struct vertex_search {
    int32_t first;         /* index of its first row */
    double inside_m;       /* nearest of those on faces */
    double nearest_m;      /* nearest edge or vertex */
    tm_touching_row edged; /* its row */
    int32_t left_out;      /* body that the vertex is inside of: it has one row of its own with it; -1: none */
} vertex_search;

/* Returns whether vertex and face are of one body. */
static bool is_own(const tm_touching *t, const tm_touch_pair *pair) {
    return t->surface.body[pair->a] == tm_touch_body(t, pair->b);
}

/* A vertex is behind a face of another body. */
static void suspect(tm_touching *t, const tm_touch_pair *pair, double depth_m) {
    int32_t v[3];
    tm_touch_suspect(t, pair->a);
    tm_touch_triangle(t, pair->b, v);
    tm_touch_follow(t, pair, depth_m, v, 3);
}

static void try_inside(tm_touching *t, const tm_touch_pair *pair, const tm_touch_closest *c, vertex_search *search) {
    double n[3], own[3];
    tm_touching_row row;
    normal_of(t, pair->b, n);
    if (is_own(t, pair) && is_inverted(t, pair->b, n)) return;
    const double signed_m = vdot(c->offset, n);
    if (signed_m < 0) { /* passed through, if its own surface looks the other way; else it is on the far side */
        if (!is_own(t, pair)) suspect(t, pair, -signed_m);
        vertex_normal(t, pair->a, own);
        if (-signed_m > t->def.thickness_m || vdot(own, n) > -0.1 || are_crushed(t, 0, pair)) return;
        t->report.deepest_m = law_max(t->report.deepest_m, -signed_m);
    }
    set_vertex_face(t, pair, c, n, signed_m, &row);
    if (row.gap_m > lookahead_m(t, &row)) return;
    search->inside_m = law_min(search->inside_m, law_max(signed_m, 0));
    tm_touch_add_row(t, &row, t->def.compliance_m_N);
}

/* Tries a pair that is nearer than its thickness and `reach_m`. */
static void try_pair(tm_touching *t, tm_touch_pair *pair, double reach_m, vertex_search *search) {
    double p[3], x[3][3];
    tm_touch_at(t->world, pair->a, p);
    int32_t v[3];
    tm_touch_triangle(t, pair->b, v);
    for (int j = 0; j < 3; j++) tm_touch_at(t->world, v[j], x[j]);
    const tm_touch_closest c = tm_touch_point_triangle(p, x[0], x[1], x[2]);
    if (c.distance_m > pair->thickness_m + reach_m) {
        send_to_sleep(t, pair, c.distance_m);
        return;
    }
    if (c.inside) {
        try_inside(t, pair, &c, search);
        return;
    }
    double n[3], away[3];
    normal_of(t, pair->b, n);
    if (is_own(t, pair) && is_inverted(t, pair->b, n)) return;
    if (!(vunit(c.offset, away) > 0) || vdot(away, n) < 0 || !(c.distance_m < search->nearest_m)) return;
    search->nearest_m = c.distance_m;
    set_vertex_face(t, pair, &c, away, c.distance_m, &search->edged);
}

/* Tries the pairs of one vertex in a list, from `i` on. Returns the index behind them. */
static int32_t try_pairs_of(tm_touching *t, tm_touch_list *list, int32_t i, int32_t vertex, double reach_m,
                            vertex_search *search) {
    for (; i < list->count && list->pair[i].a == vertex; i++)
        if (!is_asleep(t, list->pair + i) && tm_touch_body(t, list->pair[i].b) != search->left_out)
            try_pair(t, list->pair + i, reach_m, search);
    return i;
}

/* Adds the row that pushes a vertex out of another body along the shortest way. */
static void push_out(tm_touching *t, const tm_touch_inside *inside) {
    const tm_touch_pair pair = {.a = inside->vertex, .b = inside->face, .thickness_m = inside->thickness_m};
    tm_touching_row row;
    double out[3];
    vscale(-1 / inside->closest.distance_m, inside->closest.offset, out);
    set_vertex_face(t, &pair, &inside->closest, out, -inside->closest.distance_m, &row);
    tm_touch_add_row(t, &row, t->def.compliance_m_N);
}

static int32_t least(int32_t a, int32_t b) { return a < b ? a : b; }

static void find_vertices(tm_touching *t) {
    for (int32_t i = 0, k = 0, m = 0; i < t->near.vf.count || k < t->fast.vf.count || m < t->inside_count;) {
        const int32_t vertex = least(i < t->near.vf.count ? t->near.vf.pair[i].a : INT32_MAX,
                                     least(k < t->fast.vf.count ? t->fast.vf.pair[k].a : INT32_MAX,
                                           m < t->inside_count ? t->inside[m].vertex : INT32_MAX));
        vertex_search search = {.first = t->row_count, .inside_m = INFINITY, .nearest_m = INFINITY, .left_out = -1};
        const bool listed = m < t->inside_count && t->inside[m].vertex == vertex;
        if (listed) search.left_out = tm_touch_body(t, t->inside[m].face);
        i = try_pairs_of(t, &t->near.vf, i, vertex, t->def.thickness_m, &search);
        k = try_pairs_of(t, &t->fast.vf, k, vertex, INFINITY, &search);
        if (listed) push_out(t, t->inside + m++);
        if (search.nearest_m < search.inside_m && search.edged.gap_m <= lookahead_m(t, &search.edged))
            tm_touch_add_row(t, &search.edged, t->def.compliance_m_N);
        const int32_t count = t->row_count - search.first;
        for (int32_t r = search.first; r < t->row_count; r++) /* the compliance is the vertex' */
            t->solver[r].compliance_m_N *= count;
    }
}

/* --- edges against edges --- */

/* Computes the sum of the normals of an edge's faces, and how far it sticks out: 0 flat or hollow, 1 sharp. */
static double fold_of(const tm_touching *t, int32_t edge, bool own, double n[3]) {
    const int32_t *of = t->surface.of_edge + 2 * (int64_t)edge;
    double first[3], second[3], x[3], d[3];
    normal_of(t, of[0], first);
    normal_of(t, of[1], second);
    if (own && (is_inverted(t, of[0], first) || is_inverted(t, of[1], second))) return 0;
    vset(first, n);
    vmadd(n, 1, second, n);
    const int32_t *end = t->world->tissue->mesh->edge + 2 * edge;
    int32_t v[3];
    tm_touch_triangle(t, of[1], v);
    int32_t across = v[0];
    for (int j = 1; j < 3 && (across == end[0] || across == end[1]); j++) across = v[j];
    tm_touch_at(t->world, across, d);
    tm_touch_at(t->world, end[0], x);
    vsub(d, x, d);
    if (vdot(d, first) >= 0) return 0;
    const double w = law_clamp((1 - vdot(first, second)) / FOLD, 0, 1);
    return w * w * (3 - 2 * w);
}

static void try_edges(tm_touching *t, tm_touch_pair *pair) {
    const int32_t *va = t->world->tissue->mesh->edge + 2 * pair->a, *vb = t->world->tissue->mesh->edge + 2 * pair->b;
    double x[4][3], s, r, na[3], nb[3], da[3], db[3], n[3], gap[3];
    bool inside;
    for (int j = 0; j < 2; j++) tm_touch_at(t->world, va[j], x[j]), tm_touch_at(t->world, vb[j], x[2 + j]);
    const double distance_m = tm_touch_segments(x[0], x[1], x[2], x[3], &s, &r, &inside);
    if (distance_m > pair->thickness_m + t->def.thickness_m) {
        send_to_sleep(t, pair, distance_m);
        return;
    }
    if (!inside) return;
    const bool own = t->surface.body[va[0]] == t->surface.body[vb[0]];
    const double share_a = fold_of(t, pair->a, own, na),
                 share_b = share_a > 0 || !own ? fold_of(t, pair->b, own, nb) : 0;
    vsub(x[1], x[0], da);
    vsub(x[3], x[2], db);
    for (int c = 0; c < 3; c++) gap[c] = x[2][c] + r * db[c] - x[0][c] - s * da[c];
    if (!own && vdot(gap, na) < 0) tm_touch_follow(t, pair, distance_m, va, 2);
    if (!own && vdot(gap, nb) > 0) tm_touch_follow(t, pair, distance_m, vb, 2);
    if (!(share_a * share_b > 1e-3)) return;
    vcross(da, db, n);
    vunit(n, n);
    if (vdot(n, na) - vdot(n, nb) < 0) vscale(-1, n, n);
    if (!(vdot(n, na) > 0 && vdot(n, nb) < 0)) return; /* not outward from both */
    const double signed_m = vdot(gap, n);
    if (signed_m < -t->def.thickness_m || (signed_m < 0 && are_crushed(t, 1, pair))) return;
    tm_touching_row row = {.edges = 1,
                           .a = pair->a,
                           .b = pair->b,
                           .vertex = {va[0], va[1], vb[0], vb[1]},
                           .weight = {-(1 - s), -s, 1 - r, r},
                           .thickness_m = pair->thickness_m,
                           .gap_m = signed_m - pair->thickness_m};
    vset(n, row.normal);
    if (row.gap_m > lookahead_m(t, &row)) return;
    if (signed_m < 0) t->report.deepest_m = law_max(t->report.deepest_m, -signed_m);
    tm_touch_add_row(t, &row, t->def.compliance_m_N / (share_a * share_b));
}

/* --- all rows --- */

static int compare(int32_t edges, int32_t a, int32_t b, const tm_touch_memory *m) {
    if (edges != m->edges) return edges < m->edges ? -1 : 1;
    if (a != m->a) return a < m->a ? -1 : 1;
    return b != m->b ? (b < m->b ? -1 : 1) : 0;
}

/* A vertex that moves on to another face takes along the force and friction that its rows of before no longer bear. */
static void hand_on(tm_touching *t, int32_t first, int32_t end, int32_t from, int32_t to) {
    double left_N = 0, friction_N[3] = {0, 0, 0};
    int32_t unknown = 0;
    for (int32_t m = from; m < to; m++) {
        left_N += t->memory[m].lambda_N;
        vmadd(friction_N, 1, t->memory[m].friction_N, friction_N);
    }
    for (int32_t i = first; i < end; i++) {
        left_N -= t->row[i].lambda_N, unknown += t->row[i].lambda_N == 0;
        vmadd(friction_N, -1, t->solver[i].friction_N, friction_N);
    }
    for (int32_t i = first; i < end && left_N > 0 && unknown > 0; i++) {
        if (t->row[i].lambda_N != 0) continue;
        t->row[i].lambda_N = left_N / unknown;
        vscale(1.0 / unknown, friction_N, t->solver[i].friction_N);
    }
}

/* Both lists are sorted, so one pass suffices. */
static void start_warm(tm_touching *t) {
    int32_t m = 0;
    for (int32_t i = 0, end; i < t->row_count; i = end) {
        const int32_t edges = t->row[i].edges, a = t->row[i].a;
        while (m < t->memory_count && compare(edges, a, -1, t->memory + m) > 0) m++;
        const int32_t from = m;
        for (end = i; end < t->row_count && t->row[end].edges == edges && t->row[end].a == a; end++) {
            while (m < t->memory_count && compare(edges, a, t->row[end].b, t->memory + m) > 0) m++;
            if (m == t->memory_count || compare(edges, a, t->row[end].b, t->memory + m) != 0) continue;
            t->row[end].lambda_N = t->memory[m].lambda_N;
            vset(t->memory[m].drag_N, t->solver[end].drag_N);
            vset(t->memory[m].friction_N, t->solver[end].friction_N);
            t->solver[end].slips = t->memory[m].slips;
        }
        while (m < t->memory_count && t->memory[m].edges == edges && t->memory[m].a == a) m++;
        if (!edges) hand_on(t, i, end, from, m);
    }
}

/* Sorts the rows of each vertex by face: the one of the nearest edge was added last. */
static void order_rows(tm_touching *t) {
    for (int32_t i = 1; i < t->row_count; i++) {
        const tm_touching_row row = t->row[i];
        const tm_touch_solver solver = t->solver[i];
        int32_t k = i;
        for (; k > 0 && !row.edges && t->row[k - 1].a == row.a && t->row[k - 1].b > row.b; k--)
            t->row[k] = t->row[k - 1], t->solver[k] = t->solver[k - 1];
        t->row[k] = row, t->solver[k] = solver;
    }
}

/* A bound of the motion in the last substep, which the integrator of this one overwrites. */
void tm_touch_begin(tm_touching *t) {
    t->increment_m = tm_max_increment_m(t->world);
    t->updated = false;
}

void tm_touch_find(tm_touching *t) {
    tm_touch_update(t);
    tm_touch_find_fast(t);
    tm_touch_find_inside(t);
    t->row_count = 0;
    t->report.deepest_m = 0;
    tm_touch_forget_followed(t);
    find_vertices(t);
    tm_touch_check_suspect(t);
    for (int32_t i = 0; i < t->inside_count; i++)
        t->report.deepest_m = law_max(t->report.deepest_m, t->inside[i].closest.distance_m);
    for (int32_t i = 0; i < t->near.ee.count; i++)
        if (!is_asleep(t, t->near.ee.pair + i)) try_edges(t, t->near.ee.pair + i);
    order_rows(t);
    start_warm(t);
    t->report.rows = t->persistent_count = t->row_count;
    t->report.candidates = t->near.vf.count + t->near.ee.count;
}
