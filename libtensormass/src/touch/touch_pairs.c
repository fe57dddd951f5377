/* Lists of close pairs: which features may touch, from what thickness, and the order of the lists. */
#include "touch/touch_internal.h"

#include <string.h>

#include "base/vec.h"

static void add(tm_touch_list *list, const tm_touch_pair *pair) {
    if (list->count == list->room)
        list->overflowed = true;
    else
        list->pair[list->count++] = *pair;
}

/* Sets a pair, if it can touch at all. `out_m`: how far the segment between them at rest leads outward; below 0, it
 * leads through tissue. In a plane it is 0 but for rounding. */
static bool set(const tm_touching *t, int32_t a, int32_t b, bool same_body, double rest_m, double out_m,
                tm_touch_pair *pair) {
    const double full = t->def.thickness_m;
    const bool through = same_body && out_m < -1e-6 * rest_m;
    *pair = (tm_touch_pair){.a = a,
                            .b = b,
                            .thickness_m = law_min(full, same_body ? 0.5 * rest_m : rest_m),
                            .wake_m = t->odometer_m,
                            .through = through};
    return !(through && rest_m < 4 * full); /* of one fold */
}

static void rest_normal(const tm_mesh *mesh, const int32_t *v, double n[3]) {
    double ab[3], ac[3];
    vsub(mesh->rest_m + 3 * v[1], mesh->rest_m + 3 * v[0], ab);
    vsub(mesh->rest_m + 3 * v[2], mesh->rest_m + 3 * v[0], ac);
    vcross(ab, ac, n);
    vunit(n, n);
}

/* Returns whether a vertex and a face are of bodies that touch, and not of one tetrahedron: they cross only by its
 * inversion. */
static bool are_separate(const tm_touching *t, int32_t v, int32_t face, const int32_t w[3]) {
    return v != w[0] && v != w[1] && v != w[2] && v != t->world->tissue->mesh->tet[face] &&
           tm_touch_enabled(t, t->surface.body[v], tm_touch_body(t, face));
}

bool tm_touch_may_touch_face(const tm_touching *t, int32_t v, int32_t face, tm_touch_pair *pair) {
    const double *rest = t->world->tissue->mesh->rest_m;
    int32_t w[3];
    double n[3];
    tm_touch_triangle(t, face, w);
    if (!are_separate(t, v, face, w)) return false;
    rest_normal(t->world->tissue->mesh, w, n);
    const tm_touch_closest c = tm_touch_point_triangle(rest + 3 * v, rest + 3 * w[0], rest + 3 * w[1], rest + 3 * w[2]);
    return set(t, v, face, t->surface.body[v] == tm_touch_body(t, face), c.distance_m, vdot(c.offset, n), pair);
}

void tm_touch_try_vertex_face(const tm_touching *t, tm_touch_lists *to, int32_t v, int32_t face) {
    const double *x = t->place_m;
    int32_t w[3];
    tm_touch_pair pair;
    tm_touch_triangle(t, face, w);
    if (!are_separate(t, v, face, w)) return;
    if (tm_touch_point_triangle(x + 3 * v, x + 3 * w[0], x + 3 * w[1], x + 3 * w[2]).distance_m >
        t->reach_m + t->margin_m)
        return;
    if (tm_touch_may_touch_face(t, v, face, &pair)) add(&to->vf, &pair);
}

/* Returns whether two edges are opposite edges of one tetrahedron: they cross only by its inversion. */
static bool are_opposite(const tm_tissue *tissue, int32_t a, const int32_t b[2]) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t i = mesh->edge_tet_begin[a]; i < mesh->edge_tet_begin[a + 1]; i++) {
        const int32_t *tet = mesh->tet + 4 * (int64_t)mesh->edge_tet[i];
        int found = 0;
        for (int j = 0; j < 4; j++) found += tet[j] == b[0] || tet[j] == b[1];
        if (found == 2 && tissue->alive[mesh->edge_tet[i]]) return true;
    }
    return false;
}

static bool are_of_touching_bodies(const tm_touching *t, const int32_t a[2], const int32_t b[2]) {
    return a[0] != b[0] && a[0] != b[1] && a[1] != b[0] && a[1] != b[1] &&
           tm_touch_enabled(t, t->surface.body[a[0]], t->surface.body[b[0]]);
}

bool tm_touch_may_touch_edges(const tm_touching *t, int32_t a, int32_t b, tm_touch_pair *pair) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t *va = mesh->edge + 2 * a, *vb = mesh->edge + 2 * b;
    if (!are_of_touching_bodies(t, va, vb)) return false;
    const double *y[4] = {mesh->rest_m + 3 * va[0], mesh->rest_m + 3 * va[1], mesh->rest_m + 3 * vb[0],
                          mesh->rest_m + 3 * vb[1]};
    double s, r, n[3] = {0, 0, 0}, from[3], to[3];
    bool inside;
    const double rest_m = tm_touch_segments(y[0], y[1], y[2], y[3], &s, &r, &inside);
    for (int k = 0; k < 2; k++) {
        double one[3];
        int32_t w[3];
        tm_touch_triangle(t, t->surface.of_edge[2 * (int64_t)a + k], w);
        rest_normal(mesh, w, one);
        vmadd(n, 1, one, n);
    }
    for (int c = 0; c < 3; c++) {
        from[c] = y[0][c] + s * (y[1][c] - y[0][c]);
        to[c] = y[2][c] + r * (y[3][c] - y[2][c]) - from[c];
    }
    return set(t, a, b, t->surface.body[va[0]] == t->surface.body[vb[0]], rest_m, vdot(to, n), pair) &&
           !are_opposite(t->world->tissue, a, vb);
}

void tm_touch_try_edges(const tm_touching *t, tm_touch_lists *to, int32_t a, int32_t b) {
    const int32_t *va = t->world->tissue->mesh->edge + 2 * a, *vb = t->world->tissue->mesh->edge + 2 * b;
    const double *x = t->place_m;
    double s, r;
    bool inside;
    tm_touch_pair pair;
    if (!are_of_touching_bodies(t, va, vb)) return;
    if (tm_touch_segments(x + 3 * va[0], x + 3 * va[1], x + 3 * vb[0], x + 3 * vb[1], &s, &r, &inside) >
        t->reach_m + t->margin_m)
        return;
    if (tm_touch_may_touch_edges(t, a, b, &pair)) add(&to->ee, &pair);
}

/* --- order of the lists: by a, then b --- */

static bool before(const tm_touch_pair *p, const tm_touch_pair *q) { return p->a != q->a ? p->a < q->a : p->b < q->b; }

static void sift(tm_touch_pair *pair, int32_t at, int32_t count) {
    const tm_touch_pair moving = pair[at];
    for (int32_t child; (child = 2 * at + 1) < count; at = child) {
        if (child + 1 < count && before(pair + child, pair + child + 1)) child++;
        if (!before(&moving, pair + child)) break;
        pair[at] = pair[child];
    }
    pair[at] = moving;
}

/* Heap sort, without memory. */
static void sort(tm_touch_pair *pair, int32_t count) {
    for (int32_t i = count / 2 - 1; i >= 0; i--) sift(pair, i, count);
    for (int32_t end = count - 1; end > 0; end--) {
        const tm_touch_pair last = pair[end];
        pair[end] = pair[0], pair[0] = last;
        sift(pair, 0, end);
    }
}

void tm_touch_list_merge(tm_touch_list *list, int32_t kept, tm_touch_pair *scratch) {
    tm_touch_pair *pair = list->pair;
    const int32_t added = list->count - kept;
    sort(pair + kept, added);
    if (kept == 0 || added == 0) return;
    memcpy(scratch, pair + kept, sizeof *pair * (size_t)added);
    for (int32_t i = kept - 1, k = added - 1, at = list->count - 1; k >= 0; at--)
        pair[at] = i >= 0 && before(scratch + k, pair + i) ? pair[i--] : scratch[k--];
}

void tm_touch_list_drop_doubles(tm_touch_list *list) {
    int32_t kept = 0;
    for (int32_t i = 0; i < list->count; i++)
        if (i == 0 || before(list->pair + i - 1, list->pair + i)) list->pair[kept++] = list->pair[i];
    list->count = kept;
}
