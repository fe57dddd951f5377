/* True overlap of surfaces, for tests of contact of tissue. Uses tetrahedra and places alone: no rows, lists or code of
 * the stage "touch".
 *
 * A point is covered by a body as often as its tetrahedra contain it, inverted ones counted negatively; that is the
 * winding number of the body's surface. A vertex overlaps if another body covers it, or if tetrahedra of its own body
 * that it does not belong to do. So does a point of an edge that pierces a face. Its depth is the distance to the
 * surface that it is under. A vertex that is pushed through its own tetrahedra is not covered twice, and so no overlap.
 * Where tissue is crushed, so that tetrahedra are inverted there, a body's overlap with itself is measured apart. */
#ifndef TM_TEST_OVERLAP_H
#define TM_TEST_OVERLAP_H

#include "../fixture.h"
#include "tensormass/touch.h"
#include "tissue/tissue_internal.h"

typedef struct overlap {
    double deepest_m;            /* of vertices and edges */
    double crushed_m;            /* of a body with itself, next to inverted tetrahedra: not in the others */
    int32_t vertices, crossings; /* vertices that overlap, and edges with points that overlap between two crossings */
    int32_t at[2], under;        /* the deepest vertex or edge, and the body whose surface it is under */
} overlap;

typedef struct overlap_face {
    int32_t key[3], vertex[3], tet;
} overlap_face;

typedef struct overlap_box {
    double low[3], high[3];
} overlap_box;

typedef struct overlap_scene {
    const tm_tissue *tissue;
    const int32_t *tet_body; /* null: one body */
    int32_t body_count;
    const uint8_t *pair;      /* [body_count*body_count] or null, as in tm_touching_def */
    double *x;                /* [3*vertices] places */
    const int32_t *edge;      /* [2*edges] of the surface */
    int32_t *body;            /* [vertices] of vertices on the surface; -1: inside */
    const overlap_face *face; /* of the surface */
    overlap_box *tet_box, *face_box, body_box[TM_MAX_BODIES];
    int32_t faces, edges;
    overlap found;
} overlap_scene;

static inline int32_t overlap_body(const overlap_scene *s, int32_t tet) { return s->tet_body ? s->tet_body[tet] : 0; }

static inline bool overlap_touches(const overlap_scene *s, int32_t a, int32_t b) {
    return !s->pair || s->pair[a * s->body_count + b];
}

static inline void overlap_sub(const double *a, const double *b, double *c) {
    for (int k = 0; k < 3; k++) c[k] = a[k] - b[k];
}

static inline double overlap_dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline double overlap_det(const double *a, const double *b, const double *c) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/* --- the surface --- */

static inline int overlap_compare_faces(const void *a, const void *b) {
    return memcmp(((const overlap_face *)a)->key, ((const overlap_face *)b)->key, sizeof(int32_t) * 3);
}

static inline int overlap_compare_edges(const void *a, const void *b) { return memcmp(a, b, 2 * sizeof(int32_t)); }

static inline overlap_face overlap_make_face(const int32_t *tet, int32_t t, int without) {
    overlap_face f = {.tet = t};
    for (int j = 0, n = 0; j < 4; j++)
        if (j != without) f.vertex[n++] = tet[j];
    memcpy(f.key, f.vertex, sizeof f.key);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 2; j++)
            if (f.key[j] > f.key[j + 1]) {
                const int32_t k = f.key[j];
                f.key[j] = f.key[j + 1], f.key[j + 1] = k;
            }
    return f;
}

/* The surface of the last measurement: it changes with the living tetrahedra alone, and finding it takes longer than
 * the rest. */
typedef struct overlap_surface {
    int32_t *tet; /* [4*tets] and [tets] bytes `alive`: the tissue that it is of */
    uint8_t *alive;
    overlap_face *face;
    int32_t *edge, tets, faces, edges;
} overlap_surface;

/* Lists the faces of one living tetrahedron alone. */
static inline void overlap_list_faces(overlap_surface *s) {
    int32_t count = 0;
    s->faces = 0, s->face = malloc(sizeof *s->face * 4 * (size_t)s->tets);
    for (int32_t t = 0; t < s->tets; t++)
        for (int j = 0; j < 4 && s->alive[t]; j++) s->face[count++] = overlap_make_face(s->tet + 4 * (int64_t)t, t, j);
    qsort(s->face, (size_t)count, sizeof *s->face, overlap_compare_faces);
    for (int32_t i = 0, next; i < count; i = next) {
        for (next = i + 1; next < count && !overlap_compare_faces(s->face + i, s->face + next);) next++;
        if (next == i + 1) s->face[s->faces++] = s->face[i];
    }
}

static inline void overlap_list_edges(overlap_surface *s) {
    int32_t count = 0;
    s->edges = 0, s->edge = malloc(sizeof *s->edge * 6 * (size_t)(s->faces + 1));
    for (int32_t i = 0; i < s->faces; i++)
        for (int j = 0; j < 3; j++) {
            const int32_t *key = s->face[i].key;
            s->edge[2 * count] = key[j == 2], s->edge[2 * count++ + 1] = key[j == 0 ? 1 : 2];
        }
    qsort(s->edge, (size_t)count, 2 * sizeof *s->edge, overlap_compare_edges);
    for (int32_t i = 0; i < count; i++)
        if (s->edges == 0 || overlap_compare_edges(s->edge + 2 * i, s->edge + 2 * (s->edges - 1)))
            memmove(s->edge + 2 * s->edges++, s->edge + 2 * i, 2 * sizeof *s->edge);
}

static inline const overlap_surface *overlap_surface_of(const tm_tissue *tissue) {
    static overlap_surface s;
    const size_t tets = (size_t)tissue->mesh->tet_count, bytes = sizeof *s.tet * 4 * tets;
    if (s.tets == tissue->mesh->tet_count && memcmp(s.tet, tissue->mesh->tet, bytes) == 0 &&
        memcmp(s.alive, tissue->alive, tets) == 0)
        return &s;
    free(s.tet), free(s.alive), free(s.face), free(s.edge);
    s.tets = tissue->mesh->tet_count, s.tet = malloc(bytes), s.alive = malloc(tets);
    memcpy(s.tet, tissue->mesh->tet, bytes), memcpy(s.alive, tissue->alive, tets);
    overlap_list_faces(&s);
    overlap_list_edges(&s);
    return &s;
}

static inline overlap_box overlap_box_around(const overlap_scene *s, const int32_t *vertex, int count) {
    overlap_box b = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int j = 0; j < count; j++)
        for (int c = 0; c < 3; c++) {
            const double x = s->x[3 * vertex[j] + c];
            b.low[c] = x < b.low[c] ? x : b.low[c], b.high[c] = x > b.high[c] ? x : b.high[c];
        }
    return b;
}

static inline void overlap_box_join(overlap_box *to, const overlap_box *b) {
    for (int c = 0; c < 3; c++) {
        to->low[c] = b->low[c] < to->low[c] ? b->low[c] : to->low[c];
        to->high[c] = b->high[c] > to->high[c] ? b->high[c] : to->high[c];
    }
}

static inline bool overlap_boxes_meet(const overlap_box *a, const overlap_box *b) {
    return a->low[0] <= b->high[0] && b->low[0] <= a->high[0] && a->low[1] <= b->high[1] && b->low[1] <= a->high[1] &&
           a->low[2] <= b->high[2] && b->low[2] <= a->high[2];
}

static inline void overlap_open(overlap_scene *s, const double *u_m) {
    const tm_mesh *mesh = s->tissue->mesh;
    s->x = malloc(sizeof *s->x * 3 * (size_t)mesh->vertex_count);
    s->body = malloc(sizeof *s->body * (size_t)mesh->vertex_count);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) s->x[i] = mesh->rest_m[i] + u_m[i];
    for (int32_t v = 0; v < mesh->vertex_count; v++) s->body[v] = -1;
    const overlap_surface *surface = overlap_surface_of(s->tissue);
    s->face = surface->face, s->faces = surface->faces, s->edge = surface->edge, s->edges = surface->edges;
    for (int32_t f = 0; f < 3 * s->faces; f++)
        s->body[s->face[f / 3].vertex[f % 3]] = overlap_body(s, s->face[f / 3].tet);
    s->tet_box = malloc(sizeof *s->tet_box * (size_t)mesh->tet_count);
    s->face_box = malloc(sizeof *s->face_box * (size_t)(s->faces + 1));
    for (int32_t t = 0; t < mesh->tet_count; t++)
        s->tet_box[t] = overlap_box_around(s, mesh->tet + 4 * (int64_t)t, s->tissue->alive[t] ? 4 : 0);
    for (int32_t k = 0; k < s->body_count; k++) s->body_box[k] = overlap_box_around(s, NULL, 0);
    for (int32_t f = 0; f < s->faces; f++) {
        s->face_box[f] = overlap_box_around(s, s->face[f].vertex, 3);
        overlap_box_join(s->body_box + overlap_body(s, s->face[f].tet), s->face_box + f);
    }
}

static inline void overlap_close(overlap_scene *s) { free(s->x), free(s->body), free(s->tet_box), free(s->face_box); }

/* Returns the squared distance between a point and a box. */
static inline double overlap_to_box2(const overlap_box *b, const double *p) {
    double far2 = 0;
    for (int c = 0; c < 3; c++) {
        const double d = p[c] < b->low[c] ? b->low[c] - p[c] : p[c] > b->high[c] ? p[c] - b->high[c] : 0;
        far2 += d * d;
    }
    return far2;
}

/* --- points --- */

static inline bool overlap_has(const int32_t *vertex, int count, int32_t v) {
    for (int j = 0; j < count; j++)
        if (vertex[j] == v) return true;
    return false;
}

/* Returns 1 if a tetrahedron contains the point, -1 if it is inverted and does, else 0. */
static inline int overlap_sign(const overlap_scene *s, int32_t t, const double p[3]) {
    const int32_t *v = s->tissue->mesh->tet + 4 * (int64_t)t;
    double e[4][3], at[3];
    for (int j = 0; j < 3; j++) overlap_sub(s->x + 3 * v[j + 1], s->x + 3 * v[0], e[j]);
    overlap_sub(p, s->x + 3 * v[0], e[3]);
    const double whole = overlap_det(e[0], e[1], e[2]);
    at[0] = overlap_det(e[3], e[1], e[2]) / whole, at[1] = overlap_det(e[0], e[3], e[2]) / whole;
    at[2] = overlap_det(e[0], e[1], e[3]) / whole;
    if (!(at[0] > 0 && at[1] > 0 && at[2] > 0 && at[0] + at[1] + at[2] < 1)) return 0;
    return whole > 0 ? 1 : -1;
}

/* Counts how often each body covers a point, without the tetrahedra that have both vertices. */
static inline void overlap_cover(const overlap_scene *s, const double p[3], int32_t a, int32_t b, int *cover) {
    const overlap_box at = {{p[0], p[1], p[2]}, {p[0], p[1], p[2]}};
    for (int32_t k = 0; k < s->body_count; k++) cover[k] = 0;
    for (int32_t t = 0; t < s->tissue->mesh->tet_count; t++) {
        const int32_t *v = s->tissue->mesh->tet + 4 * (int64_t)t;
        if (overlap_boxes_meet(s->tet_box + t, &at) && !(overlap_has(v, 4, a) && overlap_has(v, 4, b)))
            cover[overlap_body(s, t)] += overlap_sign(s, t, p);
    }
}

/* Returns whether a living tetrahedron that has both vertices is inverted. */
static inline bool overlap_is_inverted(const overlap_scene *s, int32_t a, int32_t b) {
    const tm_mesh *mesh = s->tissue->mesh;
    for (int32_t i = mesh->vertex_tet_begin[a]; i < mesh->vertex_tet_begin[a + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i], *v = mesh->tet + 4 * (int64_t)t;
        double e[3][3];
        if (!s->tissue->alive[t] || !overlap_has(v, 4, b)) continue;
        for (int j = 0; j < 3; j++) overlap_sub(s->x + 3 * v[j + 1], s->x + 3 * v[0], e[j]);
        if (overlap_det(e[0], e[1], e[2]) <= 0) return true;
    }
    return false;
}

/* Returns whether a body covers a point with a tetrahedron that has a vertex of an inverted one. */
static inline bool overlap_is_by_crushed(const overlap_scene *s, const double p[3], int32_t body) {
    for (int32_t t = 0; t < s->tissue->mesh->tet_count; t++) {
        const int32_t *v = s->tissue->mesh->tet + 4 * (int64_t)t;
        if (overlap_body(s, t) != body || overlap_to_box2(s->tet_box + t, p) > 0 || overlap_sign(s, t, p) == 0)
            continue;
        for (int j = 0; j < 4; j++)
            if (overlap_is_inverted(s, v[j], v[j])) return true;
    }
    return false;
}

/* Returns whether the body covers all points around this one. Where tissue is inverted, tetrahedra at the point must
 * count. */
static inline bool overlap_is_around(const overlap_scene *s, const double p[3], int32_t body) {
    int cover[TM_MAX_BODIES];
    for (int k = 0; k < 27; k++) {
        const double around[3] = {p[0] + 1e-8 * (k % 3 - 0.987), p[1] + 1e-8 * (k / 3 % 3 - 1.013),
                                  p[2] + 1e-8 * (k / 9 - 1.007)};
        overlap_cover(s, around, -1, -1, cover);
        if (cover[body] < 1) return false;
    }
    return true;
}

static inline double overlap_to_segment(const double *p, const double *a, const double *b) {
    double d[3], r[3];
    overlap_sub(b, a, d), overlap_sub(p, a, r);
    const double at = fmin(fmax(overlap_dot(r, d) / fmax(overlap_dot(d, d), 1e-300), 0), 1);
    for (int c = 0; c < 3; c++) r[c] -= at * d[c];
    return sqrt(overlap_dot(r, r));
}

static inline double overlap_to_face(const overlap_scene *s, const overlap_face *f, const double *p) {
    const double *x[3] = {s->x + 3 * f->vertex[0], s->x + 3 * f->vertex[1], s->x + 3 * f->vertex[2]};
    double e[2][3], r[3], n[3], best = INFINITY;
    for (int j = 0; j < 3; j++) best = fmin(best, overlap_to_segment(p, x[j], x[(j + 1) % 3]));
    overlap_sub(x[1], x[0], e[0]), overlap_sub(x[2], x[0], e[1]), overlap_sub(p, x[0], r);
    for (int c = 0; c < 3; c++) n[c] = e[0][(c + 1) % 3] * e[1][(c + 2) % 3] - e[0][(c + 2) % 3] * e[1][(c + 1) % 3];
    const double nn = overlap_dot(n, n), u = overlap_det(r, e[1], n) / nn, v = overlap_det(e[0], r, n) / nn;
    return u > 0 && v > 0 && u + v < 1 ? fmin(best, fabs(overlap_dot(r, n)) / sqrt(nn)) : best;
}

/* Returns the distance to the surface of a body, without the faces that have both vertices. */
static inline double overlap_depth(const overlap_scene *s, const double *p, int32_t body, int32_t a, int32_t b) {
    double best = INFINITY;
    for (int32_t f = 0; f < s->faces; f++)
        if (overlap_body(s, s->face[f].tet) == body && !(overlap_to_box2(s->face_box + f, p) > best * best) &&
            !(overlap_has(s->face[f].vertex, 3, a) && overlap_has(s->face[f].vertex, 3, b)))
            best = fmin(best, overlap_to_face(s, s->face + f, p));
    return best;
}

/* Returns how deep a vertex (a equals b), or a point of an edge, is under the surface of a body; 0: not. */
static inline double overlap_under(overlap_scene *s, const double p[3], int32_t a, int32_t b, int32_t body, int cover) {
    if (body != s->body[a]) return cover != 0 ? overlap_depth(s, p, body, a, b) : 0;
    if (cover < 1 || (overlap_is_inverted(s, a, b) && !overlap_is_around(s, p, body))) return 0;
    const double depth_m = overlap_depth(s, p, body, a, b);
    if (!overlap_is_inverted(s, a, a) && !overlap_is_inverted(s, b, b) && !overlap_is_by_crushed(s, p, body))
        return depth_m;
    s->found.crushed_m = fmax(s->found.crushed_m, depth_m);
    return 0;
}

/* Returns how deep it is under any surface that its body may touch. */
static inline double overlap_of_point(overlap_scene *s, const double p[3], int32_t a, int32_t b) {
    const double beside[3] = {p[0] + 1.3e-11, p[1] + 2.1e-11, p[2] - 0.7e-11}; /* not between two tetrahedra */
    int cover[TM_MAX_BODIES];
    double deepest_m = 0;
    overlap_cover(s, beside, a, b, cover);
    for (int32_t k = 0; k < s->body_count; k++) {
        const double depth_m = overlap_touches(s, s->body[a], k) ? overlap_under(s, p, a, b, k, cover[k]) : 0;
        deepest_m = fmax(deepest_m, depth_m);
        if (!(depth_m > s->found.deepest_m)) continue;
        s->found.deepest_m = depth_m;
        s->found.at[0] = a, s->found.at[1] = b, s->found.under = k;
    }
    return deepest_m;
}

/* --- edges --- */

/* Returns the place on an edge where it pierces a face; below 0: nowhere. */
static inline double overlap_pierces(const overlap_scene *s, int32_t a, int32_t b, const overlap_face *f) {
    const double *x = s->x + 3 * f->vertex[0], *from = s->x + 3 * a;
    double e[2][3], d[3], r[3];
    for (int j = 0; j < 2; j++) overlap_sub(s->x + 3 * f->vertex[j + 1], x, e[j]);
    overlap_sub(from, s->x + 3 * b, d), overlap_sub(from, x, r);
    const double whole = overlap_det(e[0], e[1], d);
    const double u = overlap_det(r, e[1], d) / whole, v = overlap_det(e[0], r, d) / whole;
    const double at = overlap_det(e[0], e[1], r) / whole;
    return u > 0 && v > 0 && u + v < 1 && at > 0 && at < 1 ? at : -1;
}

/* Returns whether the box of an edge meets that of a body that it may touch. */
static inline bool overlap_is_near_any(const overlap_scene *s, int32_t body, const overlap_box *box) {
    for (int32_t k = 0; k < s->body_count; k++)
        if (overlap_touches(s, body, k) && overlap_boxes_meet(box, s->body_box + k)) return true;
    return false;
}

/* Lists where an edge pierces faces, ascending, between 0 and 1. Returns the count with both ends. */
enum { OVERLAP_CUTS = 64, OVERLAP_POINTS = 15 };
static inline int overlap_list_cuts(const overlap_scene *s, const int32_t *edge, double *at) {
    const overlap_box box = overlap_box_around(s, edge, 2);
    int count = 1;
    at[0] = 0;
    const int32_t faces = overlap_is_near_any(s, s->body[edge[0]], &box) ? s->faces : 0;
    for (int32_t f = 0; f < faces && count < OVERLAP_CUTS - 1; f++) {
        const int32_t *v = s->face[f].vertex;
        if (!overlap_boxes_meet(&box, s->face_box + f) || overlap_has(v, 3, edge[0]) || overlap_has(v, 3, edge[1]))
            continue;
        if (!overlap_touches(s, s->body[edge[0]], overlap_body(s, s->face[f].tet))) continue;
        const double place = overlap_pierces(s, edge[0], edge[1], s->face + f);
        if (place < 0) continue;
        int i = count++;
        for (; at[i - 1] > place; i--) at[i] = at[i - 1];
        at[i] = place;
    }
    at[count++] = 1;
    return count;
}

static inline void overlap_try_edge(overlap_scene *s, const int32_t *edge) {
    double at[OVERLAP_CUTS];
    const int count = overlap_list_cuts(s, edge, at);
    for (int i = 0; i + 1 < count && count > 2; i++) {
        double deepest_m = 0;
        for (int k = 0; k < OVERLAP_POINTS; k++) {
            double p[3];
            const double place = at[i] + (at[i + 1] - at[i]) * (k + 0.5) / OVERLAP_POINTS;
            for (int c = 0; c < 3; c++) p[c] = (1 - place) * s->x[3 * edge[0] + c] + place * s->x[3 * edge[1] + c];
            deepest_m = fmax(deepest_m, overlap_of_point(s, p, edge[0], edge[1]));
            if (k == 1 && deepest_m == 0) break; /* between two crossings all points are covered, or none */
        }
        s->found.crossings += deepest_m > 0;
    }
}

/* Measures the overlap of all surfaces that may touch each other. */
static inline overlap measure_overlap(const tm_tissue *tissue, const double *u_m, const int32_t *tet_body,
                                      int32_t body_count, const uint8_t *pair) {
    overlap_scene s = {.tissue = tissue, .tet_body = tet_body, .body_count = body_count, .pair = pair};
    s.found.at[0] = s.found.at[1] = s.found.under = -1;
    overlap_open(&s, u_m);
    for (int32_t v = 0; v < tissue->mesh->vertex_count; v++) {
        const double depth_m = s.body[v] >= 0 ? overlap_of_point(&s, s.x + 3 * v, v, v) : 0;
        s.found.vertices += depth_m > 0;
    }
    for (int32_t e = 0; e < s.edges; e++) overlap_try_edge(&s, s.edge + 2 * e);
    overlap_close(&s);
    return s.found;
}

#endif
