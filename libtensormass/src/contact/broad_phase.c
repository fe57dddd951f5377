/* Broad phase: gathers the triangles near a tool and builds their topology. So the narrow phase finds triangles that
 * share an edge or a vertex, for any order of the surface after cuts. */
#include "contact/broad_phase.h"

#include <string.h>

#include "base/vec.h"

typedef struct box {
    double low[3], high[3];
} box;

static box capsule_box(const tm_capsule *capsule, double reach_m) {
    box b;
    for (int c = 0; c < 3; c++) {
        b.low[c] = law_min(capsule->tip_m[c], capsule->tail_m[c]) - reach_m;
        b.high[c] = law_max(capsule->tip_m[c], capsule->tail_m[c]) + reach_m;
    }
    return b;
}

static void position(const double *rest_m, const double *u_m, int32_t vertex, double out[3]) {
    for (int c = 0; c < 3; c++) out[c] = rest_m[3 * vertex + c] + (u_m ? u_m[3 * vertex + c] : 0);
}

/* Returns the distance of the axis from the bounding sphere of a triangle; infinity if its box misses the axis' box. */
static double triangle_beyond(const box *b, const tm_capsule *capsule, const double *rest_m, const double *u_m,
                              const int32_t vertex[3]) {
    double p[3][3], center[3], radius2 = 0;
    for (int c = 0; c < 3; c++) { /* most miss the box in the first direction: then nothing more is read */
        for (int j = 0; j < 3; j++) p[j][c] = rest_m[3 * vertex[j] + c] + (u_m ? u_m[3 * vertex[j] + c] : 0);
        if (law_max(law_max(p[0][c], p[1][c]), p[2][c]) < b->low[c] ||
            law_min(law_min(p[0][c], p[1][c]), p[2][c]) > b->high[c])
            return INFINITY;
    }
    for (int c = 0; c < 3; c++) center[c] = (p[0][c] + p[1][c] + p[2][c]) / 3;
    for (int j = 0; j < 3; j++) {
        double d[3];
        vsub(p[j], center, d);
        radius2 = law_max(radius2, vdot(d, d));
    }
    return vsegment(center, capsule->tip_m, capsule->tail_m) - sqrt(radius2);
}

/* Maximum number of values of a key digit. */
enum { MAX_DIGITS = 4096 };

/* Sorts keys by the digit of `bits` bits at `shift`, whose values are below `size`. Stable. No comparison, recursion or
 * allocation. */
static void sort_digit(const int64_t *from, int64_t *to, int32_t count, int shift, int bits, int32_t size) {
    int32_t begin[MAX_DIGITS + 1];
    const int64_t mask = ((int64_t)1 << bits) - 1;
    memset(begin, 0, sizeof *begin * (size_t)(size + 1));
    for (int32_t i = 0; i < count; i++) begin[(from[i] >> shift & mask) + 1]++;
    for (int32_t d = 0; d < size; d++) begin[d + 1] += begin[d];
    for (int32_t i = 0; i < count; i++) to[begin[from[i] >> shift & mask]++] = from[i];
}

/* Sorts by the two digits from `shift` on, lower one first. */
static void sort_keys(int64_t *key, int32_t count, int shift, int bits, int32_t size) {
    int64_t room[3 * TM_LOCAL_FACES];
    sort_digit(key, room, count, shift, bits, size);
    sort_digit(room, key, count, shift + bits, bits, size);
}

/* Sorts by a name in the bits above `shift`: two digits or four. */
static void sort_names(int64_t *key, int32_t count, int shift) {
    int64_t any = 0;
    int bits = 1;
    for (int32_t i = 0; i < count; i++) any |= key[i] >> shift;
    while (any >> 2 * bits) bits++;
    if (bits <= 12) {
        sort_keys(key, count, shift, bits, 1 << bits);
    } else {
        sort_keys(key, count, shift, 8, 256);
        sort_keys(key, count, shift + 16, 8, 256);
    }
}

/* Builds the vertices by sorting (name, corner); corners are below 3 * TM_LOCAL_FACES. */
static void build_vertices(tm_local_surface *s) {
    int32_t n = 0;
    for (int32_t f = 0; f < s->face_count; f++)
        for (int j = 0; j < 3; j++, n++) s->key[n] = (int64_t)s->face_vertex[f][j] << 12 | n;
    sort_names(s->key, n, 12);
    s->vertex_count = 0;
    for (int32_t i = 0; i < n; i++) {
        const int32_t corner = (int32_t)(s->key[i] & 4095), id = (int32_t)(s->key[i] >> 12);
        if (i == 0 || id != s->vertex_id[s->vertex_count - 1]) {
            s->vertex_id[s->vertex_count] = id;
            s->vertex_face[s->vertex_count++] = corner / 3;
        }
        s->face_vertex[corner / 3][corner % 3] = s->vertex_count - 1;
    }
}

/* Builds the edges by sorting (low vertex, high vertex, face, local edge) in one key: 12 + 12 + 10 + 2 bits suffice.
 * The last two are generated in order. */
static void build_edges(tm_local_surface *s) {
    int32_t n = 0;
    for (int32_t f = 0; f < s->face_count; f++)
        for (int j = 0; j < 3; j++) {
            int64_t a = s->face_vertex[f][j], b = s->face_vertex[f][(j + 1) % 3];
            s->key[n++] = ((((a < b ? a : b) << 12 | (a < b ? b : a)) << 10 | f) << 2) | j;
        }
    sort_keys(s->key, n, 12, 12, s->vertex_count);
    s->edge_count = 0;
    for (int32_t i = 0; i < n; i++) {
        int32_t j = (int32_t)(s->key[i] & 3), f = (int32_t)(s->key[i] >> 2 & 1023);
        bool first = i == 0 || s->key[i] >> 12 != s->key[i - 1] >> 12;
        if (first) {
            int32_t e = s->edge_count++;
            s->edge_vertex[e][0] = (int32_t)(s->key[i] >> 24);
            s->edge_vertex[e][1] = (int32_t)(s->key[i] >> 12 & 4095);
            s->edge_face[e][0] = f;
            s->edge_face[e][1] = -1;
        } else if (s->edge_face[s->edge_count - 1][1] < 0) {
            s->edge_face[s->edge_count - 1][1] = f;
        }
        s->face_edge[f][j] = s->edge_count - 1;
    }
}

/* Builds the fan of each vertex: the list of its edges, as offsets and one array. */
static void build_fans(tm_local_surface *s) {
    memset(s->vertex_edge_begin, 0, sizeof(int32_t) * (size_t)(s->vertex_count + 1));
    for (int32_t e = 0; e < s->edge_count; e++)
        for (int j = 0; j < 2; j++) s->vertex_edge_begin[s->edge_vertex[e][j] + 1]++;
    for (int32_t v = 0; v < s->vertex_count; v++) s->vertex_edge_begin[v + 1] += s->vertex_edge_begin[v];
    for (int32_t e = s->edge_count - 1; e >= 0; e--) /* filled backwards, so that begin has its final value */
        for (int j = 0; j < 2; j++) {
            int32_t v = s->edge_vertex[e][j];
            s->vertex_edge[--s->vertex_edge_begin[v + 1]] = e;
        }
    /* each begin[v+1] is now the start of v: shift down */
    for (int32_t v = 0; v < s->vertex_count; v++) s->vertex_edge_begin[v] = s->vertex_edge_begin[v + 1];
    s->vertex_edge_begin[s->vertex_count] = 2 * s->edge_count;
}

static double longest_edge(const double *rest_m, const double *u_m, const int32_t vertex[3]) {
    double p[3][3], d[3], longest = 0;
    for (int j = 0; j < 3; j++) position(rest_m, u_m, vertex[j], p[j]);
    for (int j = 0; j < 3; j++) {
        vsub(p[(j + 1) % 3], p[j], d);
        longest = law_max(longest, vnorm(d));
    }
    return longest;
}

/* Finds keys (name, slot) of the triangles within reach_m + edge_m, and the longest edge of those within reach_m. */
static int32_t near_triangles(tm_local_surface *s, const double *rest_m, const double *u_m, const int32_t *triangle,
                              const int32_t *face, const int32_t *candidate, int32_t candidate_count,
                              const tm_capsule *capsule, double reach_m, double edge_m, double *longest_m) {
    box b = capsule_box(capsule, reach_m + edge_m);
    int32_t n = 0;
    s->overflowed = false;
    *longest_m = 0;
    for (int32_t i = 0; i < candidate_count; i++) {
        int32_t slot = candidate ? candidate[i] : i;
        const int32_t *vertex = triangle + 3 * slot;
        double beyond = triangle_beyond(&b, capsule, rest_m, u_m, vertex);
        if (beyond > reach_m + edge_m) continue;
        if (n == TM_LOCAL_FACES) {
            s->overflowed = true;
            break;
        }
        if (beyond <= reach_m) *longest_m = law_max(*longest_m, longest_edge(rest_m, u_m, vertex));
        s->key[n++] = (int64_t)face[slot] << 32 | slot;
    }
    return n;
}

void tm_local_gather(tm_local_surface *s, const double *rest_m, const double *u_m, const int32_t *triangle,
                     const int32_t *face, const int32_t *candidate, int32_t candidate_count, const tm_capsule *capsule,
                     double reach_m) {
    /* One edge farther than the reach of the rows: blended normals need complete fans. The edge length is found on the
     * way. */
    double edge_m = 1.2 * s->edge_m;
    int32_t n = near_triangles(s, rest_m, u_m, triangle, face, candidate, candidate_count, capsule, reach_m, edge_m,
                               &s->edge_m);
    if (s->edge_m > edge_m && n < TM_LOCAL_FACES) {
        double unused;
        n = near_triangles(s, rest_m, u_m, triangle, face, candidate, candidate_count, capsule, reach_m, s->edge_m,
                           &unused);
    }
    sort_names(s->key, n, 32); /* names are persistent, slots change with cuts */
    s->face_count = n;
    for (int32_t f = 0; f < n; f++) {
        const int32_t *vertex = triangle + 3 * (int32_t)(s->key[f] & 0xffffffff);
        double a[3], b[3];
        s->face_id[f] = (int32_t)(s->key[f] >> 32);
        for (int j = 0; j < 3; j++) s->face_vertex[f][j] = vertex[j];
        vsub(rest_m + 3 * vertex[1], rest_m + 3 * vertex[0], a);
        vsub(rest_m + 3 * vertex[2], rest_m + 3 * vertex[0], b);
        vcross(a, b, s->rest_normal[f]);
        vunit(s->rest_normal[f], s->rest_normal[f]);
    }
    build_vertices(s);
    build_edges(s);
    build_fans(s);
    s->near.known = false;
}

void tm_local_place(tm_local_surface *s, const double *rest_m, const double *u_m) {
    for (int32_t v = 0; v < s->vertex_count; v++) position(rest_m, u_m, s->vertex_id[v], s->position_m[v]);
}

void tm_local_face(tm_local_surface *s, int32_t f) {
    const double *p[3];
    double a[3], b[3], d[3], radius2 = 0, *area = s->area_normal[f];
    s->inward_known[f] = 0;
    for (int j = 0; j < 3; j++) p[j] = s->position_m[s->face_vertex[f][j]];
    for (int c = 0; c < 3; c++) s->center_m[f][c] = (p[0][c] + p[1][c] + p[2][c]) / 3;
    for (int j = 0; j < 3; j++) {
        vsub(p[j], s->center_m[f], d);
        radius2 = law_max(radius2, vdot(d, d));
    }
    s->reach_m[f] = sqrt(radius2);
    vsub(p[1], p[0], a);
    vsub(p[2], p[0], b);
    vcross(a, b, area);
    if (vunit(area, s->normal[f]) <= 1e-9 * radius2) /* degenerate to a line: no usable normal */
        memset(s->normal[f], 0, sizeof s->normal[f]);
}
