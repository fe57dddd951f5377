/* Computes the signed distance to a closed triangle surface. A grid finds the nearest triangle; pseudonormals
 * (Baerentzen and Aanaes 2005) give the sign. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "signed_distance.h"

#define LAW_REAL double
#include "libtensormass/numeric/union_find.h"
#include "libtensormass/numeric/vec.h"

struct shell {
    int vertex_count, triangle_count;
    double *vertex;        /* [3*vertex_count] m */
    int *triangle;         /* [3*triangle_count] */
    double *face_normal;   /* [3*triangle_count] unit */
    double *edge_normal;   /* [9*triangle_count] sum of both faces' normals at the edge from corner k to k+1 */
    double *vertex_normal; /* [3*vertex_count] angle-weighted */
    double low[3], high[3], cell, volume_m3;
    int cells[3], *cell_begin, *cell_triangle;
    signed char *cell_side; /* [cells] sign of cells without triangles: 1 inside, -1 outside, 0 not yet computed */
    bool turned;            /* its triangles were reversed */
};

/* ---- joining ---- */

static const double *sort_points; /* qsort has no context */
static int by_place(const void *a, const void *b) {
    const double *p = sort_points + 3 * (size_t) * (const int *)a, *q = sort_points + 3 * (size_t) * (const int *)b;
    for (int k = 0; k < 3; k++)
        if (p[k] != q[k]) return p[k] < q[k] ? -1 : 1;
    return 0;
}

/* Merges corners at equal positions into vertices. */
static bool join(shell *s) {
    int n = 3 * s->triangle_count, *order = malloc((size_t)n * sizeof *order);
    double *vertex = malloc(3 * (size_t)n * sizeof *vertex);
    s->triangle = malloc((size_t)n * sizeof *s->triangle);
    if (order && vertex && s->triangle) {
        for (int i = 0; i < n; i++) order[i] = i;
        sort_points = s->vertex;
        qsort(order, (size_t)n, sizeof *order, by_place);
        for (int i = 0; i < n; i++) {
            if (i == 0 || by_place(&order[i], &order[i - 1]) != 0)
                memcpy(vertex + 3 * (size_t)s->vertex_count++, s->vertex + 3 * (size_t)order[i], 3 * sizeof *vertex);
            s->triangle[order[i]] = s->vertex_count - 1;
        }
        free(order);
        free(s->vertex);
        s->vertex = vertex;
        return true;
    }
    free(order);
    free(vertex);
    return false;
}

typedef struct side {
    int from, to, at; /* at = 3*triangle + corner */
} side;

static int by_ends(const void *a, const void *b) {
    const side *x = a, *y = b;
    return x->from != y->from ? (x->from < y->from ? -1 : 1) : (x->to > y->to) - (x->to < y->to);
}

static double *at3(double *array, int i) { return array + 3 * (size_t)i; }

static void normals_of_faces(shell *s) {
    for (int t = 0; t < s->triangle_count; t++) {
        const int *v = s->triangle + 3 * (size_t)t;
        double u[3], w[3], n[3];
        vsub(at3(s->vertex, v[1]), at3(s->vertex, v[0]), u);
        vsub(at3(s->vertex, v[2]), at3(s->vertex, v[0]), w);
        vcross(u, w, n);
        s->volume_m3 += vdot(n, at3(s->vertex, v[0])) / 6;
        double length = sqrt(vdot(n, n));
        for (int k = 0; k < 3; k++) at3(s->face_normal, t)[k] = length > 0 ? n[k] / length : 0;
        for (int c = 0; c < 3; c++) {
            vsub(at3(s->vertex, v[(c + 1) % 3]), at3(s->vertex, v[c]), u);
            vsub(at3(s->vertex, v[(c + 2) % 3]), at3(s->vertex, v[c]), w);
            double lengths = sqrt(vdot(u, u) * vdot(w, w)),
                   angle = lengths > 0 ? acos(fmax(-1, fmin(1, vdot(u, w) / lengths))) : 0;
            for (int k = 0; k < 3; k++) at3(s->vertex_normal, v[c])[k] += angle * at3(s->face_normal, t)[k];
        }
    }
}

/* Computes edge normals. Each directed edge and its opposite must occur once. */
static tm_status normals_of_edges(shell *s, tm_error *error) {
    int n = 3 * s->triangle_count;
    side *sides = malloc((size_t)n * sizeof *sides);
    if (!sides) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
    for (int i = 0; i < n; i++) sides[i] = (side){s->triangle[i], s->triangle[i % 3 == 2 ? i - 2 : i + 1], i};
    qsort(sides, (size_t)n, sizeof *sides, by_ends);
    int open = 0, first = -1;
    for (int i = 0; i < n; i++) {
        side back = {sides[i].to, sides[i].from, 0}, *other = bsearch(&back, sides, (size_t)n, sizeof *sides, by_ends);
        bool twice = i > 0 && by_ends(&sides[i], &sides[i - 1]) == 0;
        if (!other || twice || sides[i].from == sides[i].to) {
            open++;
            if (first < 0) first = sides[i].at / 3;
            continue;
        }
        for (int k = 0; k < 3; k++)
            at3(s->edge_normal, sides[i].at)[k] =
                at3(s->face_normal, sides[i].at / 3)[k] + at3(s->face_normal, other->at / 3)[k];
    }
    free(sides);
    if (open)
        return tm_fail(
            error, TM_ERR_MESH, first,
            "the surface is not closed: %d edges have only one triangle, one at triangle %d; close its holes and "
            "orient its triangles (--repair, or MeshLab, Blender)",
            open, first + 1);
    return TM_OK;
}

/* ---- the grid ---- */

static int cell_at(const shell *s, int axis, double x) {
    /* bounded before the cast: x may be any number */
    return (int)fmax(0, fmin(s->cells[axis] - 1, floor((x - s->low[axis]) / s->cell)));
}

static void triangle_cells(const shell *s, int t, int low[3], int high[3]) {
    for (int k = 0; k < 3; k++) {
        double least = INFINITY, most = -INFINITY;
        for (int c = 0; c < 3; c++) {
            double x = s->vertex[3 * (size_t)s->triangle[3 * t + c] + (size_t)k];
            least = fmin(least, x);
            most = fmax(most, x);
        }
        low[k] = cell_at(s, k, least);
        high[k] = cell_at(s, k, most);
    }
}

static bool make_grid(shell *s) {
    double volume = 1;
    for (int k = 0; k < 3; k++) s->low[k] = INFINITY, s->high[k] = -INFINITY;
    for (int i = 0; i < 3 * s->vertex_count; i++) {
        s->low[i % 3] = fmin(s->low[i % 3], s->vertex[i]);
        s->high[i % 3] = fmax(s->high[i % 3], s->vertex[i]);
    }
    for (int k = 0; k < 3; k++) volume *= fmax(s->high[k] - s->low[k], 1e-9);
    s->cell = cbrt(volume / fmin(2e6, 8.0 * s->triangle_count + 64));
    for (int k = 0; k < 3; k++) s->cells[k] = (int)fmin(400, (s->high[k] - s->low[k]) / s->cell) + 1;
    for (int k = 0; k < 3; k++) s->cell = fmax(s->cell, (s->high[k] - s->low[k]) / s->cells[k]);
    size_t cells = (size_t)s->cells[0] * (size_t)s->cells[1] * (size_t)s->cells[2];
    s->cell_begin = calloc(cells + 2, sizeof *s->cell_begin);
    s->cell_side = calloc(cells, 1);
    for (int fill = 0; s->cell_begin && fill < 2; fill++) {
        for (int t = 0; t < s->triangle_count; t++) {
            int low[3], high[3];
            triangle_cells(s, t, low, high);
            for (int z = low[2]; z <= high[2]; z++)
                for (int y = low[1]; y <= high[1]; y++)
                    for (int x = low[0]; x <= high[0]; x++) {
                        size_t c = ((size_t)z * (size_t)s->cells[1] + (size_t)y) * (size_t)s->cells[0] + (size_t)x;
                        if (fill)
                            s->cell_triangle[s->cell_begin[c + 1]++] = t;
                        else
                            s->cell_begin[c + 2]++;
                    }
        }
        if (fill) break;
        for (size_t c = 0; c < cells; c++) s->cell_begin[c + 2] += s->cell_begin[c + 1];
        s->cell_triangle = malloc(((size_t)s->cell_begin[cells + 1] + 1) * sizeof *s->cell_triangle);
        if (!s->cell_triangle) return false;
    }
    return s->cell_begin && s->cell_side;
}

/* Computes normals; reverses the triangles if they point inward. */
static tm_status orient(shell *s, bool closed, tm_error *error) {
    for (int turn = 0;; turn++) {
        free(s->face_normal);
        free(s->edge_normal);
        free(s->vertex_normal);
        s->volume_m3 = 0;
        s->face_normal = calloc(3 * (size_t)s->triangle_count, sizeof *s->face_normal);
        s->edge_normal = calloc(9 * (size_t)s->triangle_count, sizeof *s->edge_normal);
        s->vertex_normal = calloc(3 * (size_t)s->vertex_count, sizeof *s->vertex_normal);
        if (!s->face_normal || !s->edge_normal || !s->vertex_normal)
            return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
        normals_of_faces(s);
        if (!closed) return TM_OK;
        tm_status status = normals_of_edges(s, error);
        if (status || s->volume_m3 >= 0 || turn == 1) return status;
        s->turned = true;
        for (int t = 0; t < s->triangle_count; t++) { /* inverted */
            int *v = s->triangle + 3 * (size_t)t, spare = v[1];
            v[1] = v[2];
            v[2] = spare;
        }
    }
}

/* Checks that every coordinate is finite, and small enough for squares of differences. */
static tm_status check_corners(const double *corner_m, int triangles, tm_error *error) {
    if (triangles < 1) return tm_fail(error, TM_ERR_MESH, -1, "it has no triangles; save the surface again");
    for (size_t i = 0; i < 9 * (size_t)triangles; i++)
        if (!(fabs(corner_m[i]) < 1e100))
            return tm_fail(error, TM_ERR_MESH, (int64_t)(i / 9),
                           "triangle %zu has a coordinate that is nan or infinite; save the surface again", i / 9 + 1);
    return TM_OK;
}

tm_status shell_of_triangles(double *corner_m, int triangles, bool closed, shell **out, tm_error *error) {
    shell *s = NULL;
    tm_status status = check_corners(corner_m, triangles, error);
    if (!status && !(s = calloc(1, sizeof *s))) status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
    if (status) {
        free(corner_m);
        return status;
    }
    s->vertex = corner_m;
    s->triangle_count = triangles;
    status = join(s) ? TM_OK : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
    if (!status) status = orient(s, closed, error);
    if (!status && !make_grid(s)) status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
    if (status)
        shell_free(s);
    else
        *out = s;
    return status;
}

void shell_free(shell *s) {
    if (!s) return;
    free(s->vertex);
    free(s->triangle);
    free(s->face_normal);
    free(s->edge_normal);
    free(s->vertex_normal);
    free(s->cell_begin);
    free(s->cell_triangle);
    free(s->cell_side);
    free(s);
}

int shell_triangles(const shell *s) { return s->triangle_count; }
double shell_volume_m3(const shell *s) { return s->volume_m3; }
bool shell_turned(const shell *s) { return s->turned; }

const double *shell_corner_m(const shell *s, int triangle, int corner) {
    return s->vertex + 3 * (size_t)s->triangle[3 * (size_t)triangle + (size_t)corner];
}

const double *shell_normal(const shell *s, int triangle) { return s->face_normal + 3 * (size_t)triangle; }

int shell_pieces(const shell *s, int *piece) {
    int32_t *parent = malloc((size_t)s->vertex_count * sizeof *parent);
    int *number = malloc((size_t)s->vertex_count * sizeof *number), pieces = 0;
    for (int v = 0; parent && number && v < s->vertex_count; v++) parent[v] = v, number[v] = -1;
    for (int t = 0; parent && number && t < s->triangle_count; t++)
        for (int c = 1; c < 3; c++) law_join(parent, s->triangle[3 * t], s->triangle[3 * t + c]);
    for (int t = 0; parent && number && t < s->triangle_count; t++) {
        const int root = law_root(parent, s->triangle[3 * t]);
        if (number[root] < 0) number[root] = pieces++;
        piece[t] = number[root];
    }
    free(parent);
    free(number);
    return pieces ? pieces : -1;
}

/* ---- distance ---- */

typedef struct nearest {
    double square, point[3];
    const double *normal; /* of the nearest face, edge or vertex */
} nearest;

static void consider(nearest *best, const double p[3], const double q[3], const double *normal) {
    double d[3];
    vsub(p, q, d);
    double square = vdot(d, d);
    if (square >= best->square) return;
    best->square = square;
    memcpy(best->point, q, sizeof best->point);
    best->normal = normal;
}

/* Compares with triangle t: the face if p is above it, else the nearest point or end of each edge. */
static void consider_triangle(const shell *s, int t, const double p[3], nearest *best) {
    const int *v = s->triangle + 3 * (size_t)t;
    const double *n = s->face_normal + 3 * (size_t)t;
    bool above = true;
    for (int c = 0; c < 3; c++) {
        const double *a = s->vertex + 3 * (size_t)v[c], *b = s->vertex + 3 * (size_t)v[(c + 1) % 3];
        double e[3], d[3], out[3], q[3];
        vsub(b, a, e);
        vsub(p, a, d);
        vcross(e, n, out);
        above = above && vdot(out, d) <= 0;
        double along = vdot(d, e), length2 = vdot(e, e);
        if (along <= 0)
            consider(best, p, a, s->vertex_normal + 3 * (size_t)v[c]);
        else if (along >= length2)
            consider(best, p, b, s->vertex_normal + 3 * (size_t)v[(c + 1) % 3]);
        else {
            for (int k = 0; k < 3; k++) q[k] = a[k] + along / length2 * e[k];
            consider(best, p, q, s->edge_normal + 3 * (3 * (size_t)t + (size_t)c));
        }
    }
    if (!above) return;
    double d[3], q[3];
    vsub(p, s->vertex + 3 * (size_t)v[0], d);
    double height = vdot(d, n);
    for (int k = 0; k < 3; k++) q[k] = p[k] - height * n[k];
    consider(best, p, q, n);
}

/* Searches cells in growing cubes around p until no cell can be nearer than the result or `square`. */
static nearest find_nearer(const shell *s, const double p[3], double square) {
    nearest best = {.square = square};
    int middle[3];
    for (int k = 0; k < 3; k++) middle[k] = cell_at(s, k, p[k]);
    int most = s->cells[0] > s->cells[1] ? s->cells[0] : s->cells[1];
    if (s->cells[2] > most) most = s->cells[2];
    for (int ring = 0; ring <= most; ring++) {
        double reach = (ring - 1) * s->cell; /* minimum distance of this ring's cells */
        if (ring > 1 && best.square <= reach * reach) break;
        for (int z = middle[2] - ring; z <= middle[2] + ring; z++)
            for (int y = middle[1] - ring; y <= middle[1] + ring; y++)
                for (int x = middle[0] - ring; x <= middle[0] + ring; x++) {
                    bool shell_cell =
                        abs(z - middle[2]) == ring || abs(y - middle[1]) == ring || abs(x - middle[0]) == ring;
                    if (!shell_cell) {
                        x = middle[0] + ring - 1; /* continue at the far side */
                        continue;
                    }
                    if (x < 0 || y < 0 || z < 0 || x >= s->cells[0] || y >= s->cells[1] || z >= s->cells[2]) continue;
                    size_t c = ((size_t)z * (size_t)s->cells[1] + (size_t)y) * (size_t)s->cells[0] + (size_t)x;
                    for (int i = s->cell_begin[c]; i < s->cell_begin[c + 1]; i++)
                        consider_triangle(s, s->cell_triangle[i], p, &best);
                }
    }
    return best;
}

static nearest find_nearest(const shell *s, const double p[3]) { return find_nearer(s, p, INFINITY); }

double shell_box_m2(const shell *s, const double p[3]) {
    double square = 0;
    for (int k = 0; k < 3; k++) {
        const double out = fmax(fmax(s->low[k] - p[k], p[k] - s->high[k]), 0);
        square += out * out;
    }
    return square;
}

void shell_nearer(const shell *s, const double p[3], double *square, double place[3]) {
    if (shell_box_m2(s, p) >= *square) return;
    const nearest n = find_nearer(s, p, *square);
    if (n.square >= *square) return;
    *square = n.square;
    memcpy(place, n.point, sizeof n.point);
}

double shell_distance_m(const shell *s, const double p[3]) { return sqrt(find_nearest(s, p).square); }

static double inside(const void *shape, const double p[3]) {
    nearest n = find_nearest(shape, p);
    double d[3];
    vsub(p, n.point, d);
    double distance = sqrt(n.square);
    return vdot(d, n.normal) > 0 ? -distance : distance;
}

static void project(const void *shape, double p[3]) {
    nearest n = find_nearest(shape, p);
    memcpy(p, n.point, sizeof n.point);
}

bool shell_contains(const shell *s, const double p[3]) {
    size_t cell = 0;
    for (int k = 2; k >= 0; k--) {
        if (!(p[k] >= s->low[k] && p[k] <= s->high[k])) return false;
        cell = cell * (size_t)s->cells[k] + (size_t)cell_at(s, k, p[k]);
    }
    if (s->cell_begin[cell] != s->cell_begin[cell + 1]) return inside(s, p) > 0;
    if (!s->cell_side[cell]) s->cell_side[cell] = inside(s, p) > 0 ? 1 : -1;
    return s->cell_side[cell] > 0;
}

growing_solid shell_solid(const shell *s) {
    growing_solid out = {inside, project, s, {0}, {0}};
    memcpy(out.low, s->low, sizeof out.low);
    memcpy(out.high, s->high, sizeof out.high);
    return out;
}
