/* Rows of contact of tissue against a slow reference of another method: closest points by minimisation, all pairs of
 * features, surfaces counted from tetrahedra, folds by angles. Their forces are equal and opposite and turn nothing. */
#include "../long.h"
#include "touch_blocks.h"

typedef double vec[3];

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void sub(const double *a, const double *b, double *c) {
    for (int i = 0; i < 3; i++) c[i] = a[i] - b[i];
}
static void cross(const double *a, const double *b, double *c) {
    const vec r = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    memcpy(c, r, sizeof r);
}
static double norm(const double *a) { return sqrt(dot(a, a)); }

/* --- closest points by minimisation --- */

typedef double (*cost)(const vec *x, double s, double *t);

/* Minimises a convex function of s in [0, 1] by halving to thirds; t is its own best second place. */
static double minimise(cost f, const vec *x, double *s, double *t) {
    double low = 0, high = 1, a, b;
    for (int i = 0; i < 120; i++) {
        const double s1 = low + (high - low) / 3, s2 = high - (high - low) / 3;
        if (f(x, s1, &a) <= f(x, s2, &b))
            high = s2;
        else
            low = s1;
    }
    double best = INFINITY;
    for (int k = 0; k < 3; k++) { /* ends are not reached by halving */
        const double at = k == 0 ? (low + high) / 2 : k - 1, d = f(x, at, &a);
        if (d < best) best = d, *s = at, *t = a;
    }
    return best;
}

/* Returns the place in [0, most] on the line p + t d that is nearest to q. */
static double nearest_place(const double *p, const double *d, const double *q, double most) {
    vec pq;
    sub(q, p, pq);
    const double dd = dot(d, d);
    return dd > 0 ? fmin(fmax(dot(pq, d) / dd, 0), most) : 0;
}

static double segment_cost(const vec *x, double s, double *t) {
    vec p, d, r;
    for (int c = 0; c < 3; c++) p[c] = x[0][c] + s * (x[1][c] - x[0][c]);
    sub(x[3], x[2], d);
    *t = nearest_place(x[2], d, p, 1);
    for (int c = 0; c < 3; c++) r[c] = x[2][c] + *t * d[c] - p[c];
    return norm(r);
}

/* x[0] against the triangle of the others: s along its first side, t along its second. */
static double triangle_cost(const vec *x, double s, double *t) {
    vec p, d, r;
    for (int c = 0; c < 3; c++) p[c] = x[1][c] + s * (x[2][c] - x[1][c]);
    sub(x[3], x[1], d);
    *t = nearest_place(p, d, x[0], 1 - s);
    for (int c = 0; c < 3; c++) r[c] = p[c] + *t * d[c] - x[0][c];
    return norm(r);
}

enum { CASES = 9 };

/* Points of a case: general, and degenerate ones. */
static void draw_points(int which, fix_random *random, vec *x) {
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 3; c++) x[i][c] = fix_signed(random);
    const double small = pow(10, -1 - 12 * fix_uniform(random));
    for (int c = 0; c < 3; c++) {
        const double along = x[1][c] - x[0][c];
        if (which == 1) x[3][c] = x[2][c] + along;                                    /* parallel edges */
        if (which == 2) x[3][c] = x[2][c] - 0.7 * along + small * fix_signed(random); /* nearly parallel */
        if (which == 3) x[1][c] = x[0][c];                                            /* an edge, a side of no length */
        if (which == 4) x[3][c] = x[2][c];
        if (which == 5) x[1][c] = x[0][c], x[3][c] = x[2][c];
        if (which == 6) x[3][c] = x[1][c] + 0.4 * (x[2][c] - x[1][c]); /* zero area */
        if (which == 7) x[2][c] = x[0][c];                             /* a shared end */
        if (which == 8) x[2][c] = x[1][c], x[3][c] = x[1][c];          /* a triangle of one point */
    }
}

static void closest_points_agree_with_minimisation(void **state) {
    (void)state;
    fix_random random = {41};
    double off = 0;
    for (int i = 0; i < CASES * (test_is_long() ? 20000 : 500); i++) {
        vec x[4], on, r;
        double s, t, own_s, own_t;
        bool inside;
        draw_points(i % CASES, &random, x);
        const double edges = minimise(segment_cost, (const vec *)x, &s, &t);
        const double own_edges = tm_touch_segments(x[0], x[1], x[2], x[3], &own_s, &own_t, &inside);
        assert_true(own_s >= 0 && own_s <= 1 && own_t >= 0 && own_t <= 1);
        for (int c = 0; c < 3; c++)
            r[c] = x[0][c] + own_s * (x[1][c] - x[0][c]) - x[2][c] - own_t * (x[3][c] - x[2][c]);
        off = fmax(off, fmax(fabs(own_edges - edges), fabs(norm(r) - own_edges)));
        const double face = minimise(triangle_cost, (const vec *)x, &s, &t);
        const tm_touch_closest own = tm_touch_point_triangle(x[0], x[1], x[2], x[3]);
        for (int c = 0; c < 3; c++) {
            on[c] = 0;
            for (int j = 0; j < 3; j++) on[c] += own.weight[j] * x[1 + j][c];
            r[c] = x[0][c] - on[c] - own.offset[c];
        }
        off = fmax(off, fmax(fabs(own.distance_m - face), norm(r)));
        assert_true(own.weight[0] >= 0 && own.weight[1] >= 0 && own.weight[2] >= 0);
        if (off > 1e-7) fail_msg("case %d, draw %d: %.3g off", i % CASES, i, off); /* nearly parallel edges: 2e-8 */
    }
    printf("closest points: distances off by at most %.1g\n", off);
}

/* --- all pairs --- */

typedef struct feature_face {
    int32_t tet, vertex[3]; /* outward */
} feature_face;

typedef struct feature_edge {
    int32_t end[2], count, face[2]; /* two of its faces */
} feature_edge;

typedef struct reference {
    const bodies *b;
    double *x, *before; /* places now, and those a step before */
    feature_face *face;
    feature_edge *edge;
    int32_t faces, edges;
    double h;
    int32_t *hits; /* of each row: times that a pair of the reference expects it */
    int32_t expected, doubtful, kinds[4], far;
} reference;

static const double *at(const reference *r, int32_t v) { return r->x + 3 * v; }

static bool has(const int32_t *list, int n, int32_t v) {
    for (int i = 0; i < n; i++)
        if (list[i] == v) return true;
    return false;
}

/* Lists the faces that belong to one living tetrahedron. */
static void count_faces(reference *r) {
    static const int side[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    const tm_mesh *m = r->b->mesh;
    const uint8_t *alive = r->b->tissue->alive;
    r->face = malloc(sizeof *r->face * 4 * (size_t)m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++)
        for (int f = 0; f < 4 && alive[t]; f++) {
            feature_face face = {.tet = t};
            for (int j = 0; j < 3; j++) face.vertex[j] = m->tet[4 * t + side[f][j]];
            int owners = 0;
            for (int32_t o = 0; o < m->tet_count; o++) {
                int shared = 0;
                for (int j = 0; j < 3 && alive[o]; j++) shared += has(m->tet + 4 * o, 4, face.vertex[j]);
                owners += shared == 3;
            }
            if (owners == 1) r->face[r->faces++] = face;
        }
}

static void count_edges(reference *r) {
    r->edge = malloc(sizeof *r->edge * 3 * (size_t)r->faces);
    for (int32_t f = 0; f < r->faces; f++)
        for (int j = 0; j < 3; j++) {
            const int32_t a = r->face[f].vertex[j], b = r->face[f].vertex[(j + 1) % 3];
            int32_t e = 0;
            while (e < r->edges && !(has(r->edge[e].end, 2, a) && has(r->edge[e].end, 2, b))) e++;
            if (e == r->edges) r->edge[r->edges++] = (feature_edge){.end = {a < b ? a : b, a < b ? b : a}};
            if (r->edge[e].count < 2) r->edge[e].face[r->edge[e].count] = f;
            r->edge[e].count++;
        }
}

static void normal_at(const double *x, const feature_face *f, double *n) {
    vec a, b;
    sub(x + 3 * f->vertex[1], x + 3 * f->vertex[0], a);
    sub(x + 3 * f->vertex[2], x + 3 * f->vertex[0], b);
    cross(a, b, n);
    const double size = norm(n);
    for (int c = 0; c < 3; c++) n[c] /= size;
}

/* Returns the thickness of a pair as docs/bodies.md says; below 0: never a row. `to`: from the second feature to the
 * first, at rest; `n`: normal of the second. */
static double thickness_of(const reference *r, bool same, const double *to, const double *n) {
    const double rest_m = norm(to);
    if (same && dot(to, n) < -1e-6 * rest_m && rest_m < 4 * r->h) return -1;
    return fmin(r->h, same ? rest_m / 2 : rest_m);
}

static double motion_of(const reference *r, int32_t v) {
    vec moved;
    sub(at(r, v), r->before + 3 * v, moved);
    return norm(moved);
}

/* Returns how near a row may be beyond its thickness: a quarter, and twice its motion; at most one thickness, except a
 * vertex and a face of two bodies, one of whose vertices moves by more than half a thickness. */
static double ahead_of(const reference *r, const int32_t *v, const double *weight, bool edges) {
    vec moved = {0};
    double fastest = 0;
    for (int j = 0; j < 4; j++) {
        for (int c = 0; c < 3; c++) moved[c] += weight[j] * (at(r, v[j])[c] - r->before[3 * v[j] + c]);
        fastest = fmax(fastest, motion_of(r, v[j]));
    }
    const bool same = (v[0] >= r->b->body_begin[1]) == (v[3] >= r->b->body_begin[1]);
    const double ahead = r->h / 4 + 2 * norm(moved);
    return edges || same || fastest <= r->h / 2 ? fmin(r->h, ahead) : ahead;
}

/* Returns the rows of the start of the substep: those behind them depend on its end (touch_crossing.c). */
static int32_t rows_of(const bodies *b, const tm_touching_row **row) {
    tm_touching_rows(b->touching, row);
    return b->touching->persistent_count;
}

/* Expects a row with these vertices and weights. `doubtful`: rounding decides. */
static bool expect(reference *r, int kind, const int32_t *v, const double *weight, const double *n, double gap_m,
                   bool doubtful) {
    const tm_touching_row *row;
    const int32_t count = rows_of(r->b, &row);
    int32_t found = -1;
    for (int32_t i = 0; i < count && found < 0; i++) {
        bool same = row[i].edges == (kind == 2) && fabs(row[i].gap_m - gap_m) < 1e-9;
        for (int j = 0; j < 4; j++) {
            double own = 0; /* vertices in another order; of a row on an edge or vertex, another face of it */
            for (int k = 0; k < 4; k++) own += row[i].vertex[k] == v[j] ? row[i].weight[k] : 0;
            same = same && fabs(own - weight[j]) < 1e-6;
        }
        if (same && dot(row[i].normal, n) > 1 - 1e-9) found = i;
    }
    if (found >= 0) r->hits[found]++, r->far += gap_m > r->h;
    r->expected += found >= 0, r->doubtful += doubtful, r->kinds[kind] += found >= 0;
    if (found < 0 && !doubtful)
        fail_msg("no row of kind %d: vertices %d, %d %d %d, gap %.6g mm, normal %.3f %.3f %.3f", kind, v[0], v[1], v[2],
                 v[3], 1e3 * gap_m, n[0], n[1], n[2]);
    return found >= 0;
}

static bool is_near(double a, double b) { return fabs(a - b) < 1e-9; }

/* The nearest edge or vertex around a vertex, once for each face that has it, and the nearest face over which it is. */
enum { SHARED = 16 };
typedef struct around {
    double inside_m, edge_m, normal[3], weight[SHARED][4], gap_m[SHARED];
    int32_t v[SHARED][4], count;
} around;

static double closest_on_face(const double *x, int32_t vertex, const feature_face *f, double *weight, double *to) {
    vec p[4];
    double s, t;
    memcpy(p[0], x + 3 * vertex, sizeof p[0]);
    for (int j = 0; j < 3; j++) memcpy(p[1 + j], x + 3 * f->vertex[j], sizeof p[0]);
    const double d = minimise(triangle_cost, (const vec *)p, &s, &t);
    const double w[4] = {1, -(1 - s - t), -s, -t};
    memcpy(weight, w, sizeof w);
    for (int c = 0; c < 3; c++) to[c] = p[0][c] + w[1] * p[1][c] + w[2] * p[2][c] + w[3] * p[3][c];
    return d;
}

/* Returns whether the vertex' own surface looks against n. */
static bool looks_against(const reference *r, int32_t vertex, const double *n) {
    vec sum = {0}, one;
    for (int32_t f = 0; f < r->faces; f++) {
        if (!has(r->face[f].vertex, 3, vertex)) continue;
        normal_at(r->x, r->face + f, one);
        for (int c = 0; c < 3; c++) sum[c] += one[c];
    }
    return dot(sum, n) <= -0.1 * norm(sum);
}

static void try_face(reference *r, int32_t vertex, const feature_face *f, around *best) {
    const bodies *b = r->b;
    if (has(b->mesh->tet + 4 * f->tet, 4, vertex)) return;
    const bool same = (vertex >= b->body_begin[1]) == (f->vertex[0] >= b->body_begin[1]);
    vec n, to;
    double weight[4];
    normal_at(b->mesh->rest_m, f, n);
    closest_on_face(b->mesh->rest_m, vertex, f, weight, to);
    const double h = thickness_of(r, same, to, n), d = h < 0 ? 0 : closest_on_face(r->x, vertex, f, weight, to);
    const int32_t v[4] = {vertex, f->vertex[0], f->vertex[1], f->vertex[2]};
    if (h < 0 || d > h + fmax(r->h, ahead_of(r, v, weight, false))) return;
    const double least = -fmax(fmax(weight[1], weight[2]), weight[3]);
    normal_at(r->x, f, n);
    if (least > 1e-6) {
        const double signed_m = dot(to, n), ahead = ahead_of(r, v, weight, false);
        if (signed_m < 0 && (-signed_m > r->h || !looks_against(r, vertex, n))) return;
        if (signed_m - h > ahead + 1e-9) return;
        best->inside_m = fmin(best->inside_m, fmax(signed_m, 0));
        expect(r, 0, v, weight, n, signed_m - h, is_near(signed_m - h, ahead));
        return;
    }
    if (!(d > 0) || dot(to, n) < -1e-9 * d || d > best->edge_m + 1e-12) return;
    if (d < best->edge_m - 1e-12) best->count = 0, best->edge_m = d;
    assert_true(best->count < SHARED);
    for (int c = 0; c < 3; c++) best->normal[c] = to[c] / d;
    memcpy(best->v[best->count], v, sizeof v), memcpy(best->weight[best->count], weight, sizeof weight);
    best->gap_m[best->count++] = d - h;
}

/* Rounding decides which face has the edge or vertex, and they may have different thicknesses. */
static void expect_nearest(reference *r, const around *best) {
    bool all = best->edge_m < best->inside_m - 1e-9, found = false;
    for (int i = 0; i < best->count; i++)
        all &= best->gap_m[i] < ahead_of(r, best->v[i], best->weight[i], false) - 1e-9;
    for (int i = 0; i < best->count && !found; i++) {
        const bool last = i == best->count - 1;
        if (best->gap_m[i] > ahead_of(r, best->v[i], best->weight[i], false) + 1e-9) continue;
        found = expect(r, 1, best->v[i], best->weight[i], best->normal, best->gap_m[i], !last || !all);
    }
}

/* --- vertices inside the other body --- */

/* Returns whether a tetrahedron of the other body contains a vertex. */
static bool is_inside(const reference *r, int32_t vertex) {
    const bodies *b = r->b;
    for (int32_t t = 0; t < b->mesh->tet_count; t++) {
        const int32_t *v = b->mesh->tet + 4 * t;
        if (!b->tissue->alive[t] || (v[0] >= b->body_begin[1]) == (vertex >= b->body_begin[1])) continue;
        vec e[3], p, one;
        for (int j = 0; j < 3; j++) sub(at(r, v[j + 1]), at(r, v[0]), e[j]);
        sub(at(r, vertex), at(r, v[0]), p);
        cross(e[1], e[2], one);
        const double size = dot(e[0], one), x = dot(p, one) / size;
        cross(e[2], e[0], one);
        const double y = dot(p, one) / size;
        cross(e[0], e[1], one);
        const double z = dot(p, one) / size;
        if (x > 0 && y > 0 && z > 0 && x + y + z < 1) return true;
    }
    return false;
}

/* Which vertices are listed as inside is history, so it is taken from the stage. */
static bool is_listed(const reference *r, int32_t vertex) {
    for (int32_t i = 0; i < r->b->touching->inside_count; i++)
        if (r->b->touching->inside[i].vertex == vertex) return true;
    return false;
}

/* Expects the one row that pushes a vertex out of the other body along the shortest way. */
static void expect_way_out(reference *r, int32_t vertex) {
    double nearest_m = INFINITY, weight[4], best[4] = {0};
    vec to, out = {0};
    const feature_face *face = r->face;
    for (int32_t f = 0; f < r->faces; f++) {
        if ((vertex >= r->b->body_begin[1]) == (r->face[f].vertex[0] >= r->b->body_begin[1])) continue;
        const double d = closest_on_face(r->x, vertex, r->face + f, weight, to);
        if (d >= nearest_m) continue;
        nearest_m = d, face = r->face + f;
        memcpy(best, weight, sizeof best);
        for (int c = 0; c < 3; c++) out[c] = -to[c] / d;
    }
    assert_true(is_inside(r, vertex));
    const int32_t v[4] = {vertex, face->vertex[0], face->vertex[1], face->vertex[2]};
    const double rest_m = closest_on_face(r->b->mesh->rest_m, vertex, face, weight, to);
    expect(r, 3, v, best, out, -nearest_m - fmin(r->h, rest_m), false);
}

static void all_vertices(reference *r) {
    for (int32_t v = 0; v < r->b->mesh->vertex_count; v++) {
        around best = {.inside_m = INFINITY, .edge_m = INFINITY};
        bool on_surface = false;
        for (int32_t f = 0; f < r->faces; f++) on_surface |= has(r->face[f].vertex, 3, v);
        const bool listed = is_listed(r, v);
        if (listed) expect_way_out(r, v);
        for (int32_t f = 0; f < r->faces && on_surface; f++) {
            const bool same = (v >= r->b->body_begin[1]) == (r->face[f].vertex[0] >= r->b->body_begin[1]);
            if (same || !listed) try_face(r, v, r->face + f, &best);
        }
        if (best.edge_m < best.inside_m + 1e-9) expect_nearest(r, &best);
    }
}

/* Returns the share by which an edge counts: 0 flat or hollow, 1 from a fold of 14 degrees; n: between its faces. */
static double share_of(const reference *r, const feature_edge *e, double *n) {
    vec first, second, across;
    normal_at(r->x, r->face + e->face[0], first);
    normal_at(r->x, r->face + e->face[1], second);
    for (int c = 0; c < 3; c++) n[c] = first[c] + second[c];
    for (int j = 0; j < 3; j++)
        if (!has(e->end, 2, r->face[e->face[1]].vertex[j]))
            sub(at(r, r->face[e->face[1]].vertex[j]), at(r, e->end[0]), across);
    if (dot(across, first) >= 0) return 0;
    vec turn;
    cross(first, second, turn);
    const double angle = atan2(norm(turn), dot(first, second));
    const double w = fmin((1 - cos(angle)) / (1 - 0.9703), 1);
    return w * w * (3 - 2 * w);
}

static bool of_one_tetrahedron(const reference *r, const feature_edge *a, const feature_edge *b) {
    for (int32_t t = 0; t < r->b->mesh->tet_count; t++) {
        const int32_t *tet = r->b->mesh->tet + 4 * t;
        if (r->b->tissue->alive[t] && has(tet, 4, a->end[0]) && has(tet, 4, a->end[1]) && has(tet, 4, b->end[0]) &&
            has(tet, 4, b->end[1]))
            return true;
    }
    return false;
}

static double closest_of_edges(const double *x, const feature_edge *a, const feature_edge *b, double *s, double *t,
                               double *to) {
    vec p[4];
    for (int j = 0; j < 2; j++)
        memcpy(p[j], x + 3 * a->end[j], sizeof p[j]), memcpy(p[2 + j], x + 3 * b->end[j], sizeof p[j]);
    const double d = minimise(segment_cost, (const vec *)p, s, t);
    for (int c = 0; c < 3; c++) to[c] = p[2][c] + *t * (p[3][c] - p[2][c]) - p[0][c] - *s * (p[1][c] - p[0][c]);
    return d;
}

/* `a`: the edge with the lower number in the mesh. */
static void try_two_edges(reference *r, const feature_edge *a, const feature_edge *b) {
    const bool same = (a->end[0] >= r->b->body_begin[1]) == (b->end[0] >= r->b->body_begin[1]);
    if (has(a->end, 2, b->end[0]) || has(a->end, 2, b->end[1]) || of_one_tetrahedron(r, a, b)) return;
    vec to, n = {0}, na, nb, da, db;
    double s, t;
    closest_of_edges(r->b->mesh->rest_m, a, b, &s, &t, to);
    for (int k = 0; k < 2; k++) {
        normal_at(r->b->mesh->rest_m, r->face + a->face[k], na);
        for (int c = 0; c < 3; c++) n[c] += na[c];
    }
    const double h = thickness_of(r, same, to, n), d = h < 0 ? 0 : closest_of_edges(r->x, a, b, &s, &t, to);
    if (h < 0 || d > 2 * r->h || s < 1e-6 || s > 1 - 1e-6 || t < 1e-6 || t > 1 - 1e-6) return;
    const double share = share_of(r, a, na) * share_of(r, b, nb);
    sub(at(r, a->end[1]), at(r, a->end[0]), da), sub(at(r, b->end[1]), at(r, b->end[0]), db);
    cross(da, db, n);
    const double sine = norm(n) / norm(da) / norm(db), size = norm(n) * (dot(n, na) < dot(n, nb) ? -1 : 1);
    for (int c = 0; c < 3; c++) n[c] /= size;
    const double signed_m = dot(to, n), out_a = dot(n, na), out_b = -dot(n, nb);
    const int32_t v[4] = {a->end[0], a->end[1], b->end[0], b->end[1]};
    const double weight[4] = {-(1 - s), -s, 1 - t, t}, ahead = ahead_of(r, v, weight, true);
    if (share < 0.9e-3 || sine < 0.049 || out_a < -1e-9 || out_b < -1e-9 || signed_m < -r->h - 1e-9) return;
    if (signed_m - h > ahead + 1e-9) return;
    expect(r, 2, v, weight, n, signed_m - h,
           share < 1.1e-3 || sine < 0.051 || out_a < 1e-9 || out_b < 1e-9 || is_near(signed_m - h, ahead) ||
               is_near(signed_m, -r->h));
}

/* Returns the mesh's number of an edge. */
static int32_t number_of(const reference *r, const feature_edge *e) {
    for (int32_t i = 0; i < r->b->mesh->edge_count; i++)
        if (has(r->b->mesh->edge + 2 * i, 2, e->end[0]) && has(r->b->mesh->edge + 2 * i, 2, e->end[1])) return i;
    return -1;
}

static void all_edges(reference *r) {
    for (int32_t i = 0; i < r->edges; i++)
        for (int32_t k = 0; k < i; k++) {
            const bool first = number_of(r, r->edge + i) < number_of(r, r->edge + k);
            assert_true(r->edge[i].count == 2 && r->edge[k].count == 2);
            try_two_edges(r, r->edge + (first ? i : k), r->edge + (first ? k : i));
        }
}

/* The force on each vertex is its weight times one force; it lies along the line of the closest points. */
static double check_forces(const reference *r) {
    const tm_touching_row *row;
    const int32_t count = rows_of(r->b, &row);
    double worst = 0;
    for (int32_t i = 0; i < count; i++) {
        vec sum = {0}, turn = {0}, one;
        for (int j = 0; j < 4; j++) {
            vec f;
            for (int c = 0; c < 3; c++) f[c] = row[i].weight[j] * row[i].normal[c], sum[c] += f[c];
            cross(at(r, row[i].vertex[j]), f, one);
            for (int c = 0; c < 3; c++) turn[c] += one[c];
        }
        worst = fmax(worst, norm(sum));
        if (norm(turn) > 1e-12) fail_msg("row %d turns by %.3g m", i, norm(turn));
    }
    return worst;
}

static void compare(const bodies *b, reference *sum) {
    const int32_t n = 3 * b->mesh->vertex_count;
    reference r = {.b = b, .h = b->touching->def.thickness_m};
    const tm_state *s = tm_world_state(b->world);
    r.x = malloc(sizeof(double) * (size_t)n), r.before = malloc(sizeof(double) * (size_t)n);
    for (int32_t i = 0; i < n; i++)
        r.x[i] = b->mesh->rest_m[i] + s->u_m[i], r.before[i] = b->mesh->rest_m[i] + s->u_prev_m[i];
    assert_int_equal(tm_world_step(b->world, 1), TM_OK);
    const tm_touching_row *row;
    const int32_t count = rows_of(b, &row);
    r.hits = calloc((size_t)count + 1, sizeof *r.hits);
    count_faces(&r), count_edges(&r);
    all_vertices(&r), all_edges(&r);
    int32_t missed = 0;
    for (int32_t i = 0; i < count; i++) {
        missed += r.hits[i] == 0;
        if (r.hits[i] == 0)
            printf("row %d of edges %d: %d, %d is unexpected, gap %.6g mm\n", i, row[i].edges, row[i].a, row[i].b,
                   1e3 * row[i].gap_m);
    }
    assert_true(missed <= r.doubtful);
    assert_true(check_forces(&r) <= 1e-15);
    sum->expected += r.expected, sum->doubtful += r.doubtful;
    for (int k = 0; k < 4; k++) sum->kinds[k] += r.kinds[k];
    sum->far += r.far;
    free(r.x), free(r.before), free(r.hits), free(r.face), free(r.edge);
}

/* Moves the upper block. */
static void lift(bodies *b, double by_m) {
    for (int32_t v = b->body_begin[1]; v < b->body_begin[2]; v++)
        tm_world_state(b->world)->u_m[3 * v + 2] += by_m, tm_world_state(b->world)->u_prev_m[3 * v + 2] += by_m;
}

/* Two crumpled blocks pushed into each other, with holes; rows at rest and in flight, fast flight from afar, and out of
 * each other. */
static void rows_are_those_of_a_slow_reference(void **state) {
    (void)state;
    reference sum = {0};
    for (uint64_t seed = 0; seed < (test_is_long() ? 60 : 5); seed++) {
        const bool fast = seed % 5 == 3, deep = seed % 5 == 4;
        fix_random random = {100 + seed};
        setup s = plain();
        s.is_held = at_base, s.cuttable = true, s.mu = 0.2, s.touch.thickness_m = 1.5e-3;
        const part p[] = {{{3, 3, 2}, {0.015, 0.015, 0.01}, {0, 0, 0}, 0},
                          {{2, 2, 2}, {0.009, 0.008, 0.008}, {0.0031, 0.0042, 0.0115}, 0.7 * fix_signed(&random)}};
        bodies b = make(p, 2, &s);
        const int32_t gone[] = {(int32_t)(seed * 7 % 30), 40 + (int32_t)(seed * 5 % 30)};
        if (seed % 3) tm_cut_remove(b.tissue, gone, 2, NULL, 0);
        tm_state *now = tm_world_state(b.world);
        for (int32_t i = 0; i < 3 * b.mesh->vertex_count; i++)
            now->u_m[i] = now->u_prev_m[i] =
                (b.mesh->rest_m[i / 3 * 3 + 2] > 1e-9 ? deep ? 1e-5 : 1e-3 : 0) * fix_signed(&random);
        if (fast || deep) lift(&b, fast ? 4e-3 : -5e-3);
        if (!deep) throw_body(&b, 1, 0, 0, fast ? -6 : -0.3 * fix_uniform(&random));
        if (deep) assert_int_equal(tm_world_step(b.world, 12), TM_OK);
        for (int k = 0; k < (fast ? 1 : 3); k++) { /* in fast flight, before the first step alone */
            compare(&b, &sum);
            if (!fast) assert_int_equal(tm_world_step(b.world, 4), TM_OK);
        }
        drop(&b);
    }
    printf(
        "%d rows as expected: %d on faces, %d on edges and vertices of faces, %d of two edges, %d of vertices inside, "
        "%d from afar; %d decided by rounding\n",
        sum.expected, sum.kinds[0], sum.kinds[1], sum.kinds[2], sum.kinds[3], sum.far, sum.doubtful);
    assert_true(sum.kinds[0] > 50 && sum.kinds[1] > 50 && sum.kinds[2] > 10 && sum.kinds[3] > 5 && sum.far > 5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closest_points_agree_with_minimisation),
        cmocka_unit_test(rows_are_those_of_a_slow_reference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
