/* Warns about bodies that overlap as the scene places them: contact leaves such vertices alone (docs/bodies.md), so
 * that a wrong `move` or `scale` would show as bodies that do not touch. */
#include <math.h>
#include <stdlib.h>

#include "bodies.h"
#include "surface_distance.h"

/* Vertices inside another body whose depth is measured, at most: as many distances to all its faces. */
enum { MEASURED_MAX = 256 };

typedef struct point {
    double x_m;
    int32_t vertex;
    bool inside;
} point;

static int by_x(const void *a, const void *b) {
    const point *p = a, *q = b;
    return p->x_m != q->x_m ? (p->x_m > q->x_m) - (p->x_m < q->x_m) : (p->vertex > q->vertex) - (p->vertex < q->vertex);
}

/* Lists the surface vertices of a body by their x. Returns their number. `seen` [vertex_count] is scratch. */
static int32_t list_surface(const tm_mesh *mesh, const int32_t *tet_body, int32_t body, uint8_t *seen, point *list) {
    int32_t count = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) seen[v] = 0;
    for (int32_t i = 0; i < 3 * mesh->surface_count; i++) {
        const int32_t v = mesh->surface[i];
        if (seen[v] || tet_body[mesh->surface_face[i / 3] / 4] != body) continue;
        seen[v] = 1;
        list[count++] = (point){mesh->rest_m[3 * v], v, false};
    }
    qsort(list, (size_t)count, sizeof *list, by_x);
    return count;
}

/* Marks the points that are in a tetrahedron. */
static void mark(const tm_mesh *mesh, int32_t tet, point *list, int32_t count) {
    double low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 4; k++) {
        const double x = mesh->rest_m[3 * mesh->tet[4 * tet + k]];
        low = fmin(low, x), high = fmax(high, x);
    }
    int32_t first = 0, end = count;
    while (first < end) { /* the first that is not before the tetrahedron */
        const int32_t middle = first + (end - first) / 2;
        if (list[middle].x_m < low)
            first = middle + 1;
        else
            end = middle;
    }
    for (int32_t i = first; i < count && list[i].x_m <= high; i++)
        list[i].inside = list[i].inside || sim_is_in_tet(mesh, tet, mesh->rest_m + 3 * list[i].vertex);
}

/* Returns how deep surface vertices of a body are in another one, m, and sets their number. */
static double depth_in(const sim *s, const int32_t *tet_body, const point *list, int32_t count, int32_t other,
                       int32_t *inside) {
    double deepest = 0;
    *inside = 0;
    for (int32_t i = 0; i < count; i++) *inside += list[i].inside;
    const int32_t stride = *inside / MEASURED_MAX + 1;
    for (int32_t i = 0, n = 0; i < count; i++)
        if (list[i].inside && n++ % stride == 0)
            deepest = fmax(deepest, sim_body_distance(s->mesh, tet_body, other, s->mesh->rest_m + 3 * list[i].vertex));
    return deepest;
}

static tm_status warn(const sim *s, int32_t a, int32_t b, double depth_m, int32_t inside) {
    const app_body *body = s->scene->body.item, *later = body + (a > b ? a : b);
    return app_scene_warn(s->scene, later->move.line ? later->move.line : later->mesh.line,
                          "%d surface vertices of body '%s' are inside body '%s', up to %.3g mm deep, and the two do "
                          "not touch there; check 'move:', 'turn:' and 'scale:', or leave this pair out of touch.pairs",
                          inside, s->body[a].name, s->body[b].name, 1e3 * depth_m);
}

tm_status sim_warn_overlaps(const sim *s, const int32_t *tet_body, const uint8_t *pair, double tolerance_m) {
    const tm_mesh *mesh = s->mesh;
    point *list = malloc(sizeof *list * (size_t)mesh->vertex_count);
    uint8_t *seen = malloc((size_t)mesh->vertex_count);
    tm_status rc = 0;
    for (int32_t a = 0; list && seen && a < s->body_count && !rc; a++) {
        const int32_t count = list_surface(mesh, tet_body, a, seen, list);
        for (int32_t b = 0; b < s->body_count && !rc; b++) {
            int32_t inside;
            if (b == a || !pair[a * s->body_count + b] || (s->body[a].rigid && s->body[b].rigid)) continue;
            for (int32_t i = 0; i < count; i++) list[i].inside = false;
            for (int32_t t = s->body[b].tet_begin; t < s->body[b].tet_end; t++) mark(mesh, t, list, count);
            const double depth_m = depth_in(s, tet_body, list, count, b, &inside);
            if (depth_m > tolerance_m) rc = warn(s, a, b, depth_m, inside);
        }
    }
    free(list);
    free(seen);
    return rc; /* without memory no warning */
}
