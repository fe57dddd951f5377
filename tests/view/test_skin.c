/* The drawn surface: closed if the tissue's is, round where smooth, sharp at creases, and attached to the tissue
 * through cuts. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "view/surface_smoothing.h"

/* A cube of side 2 with its faces split into n*n squares; pushed out to the unit sphere if `round`. Vertices shared
 * along edges. */
static void box(view_surface *s, int n, bool round) {
    int side = n + 1, grid = side * side * side;
    int32_t *number = malloc((size_t)grid * sizeof *number);
    int32_t vertices = 0, triangles = 0;
    assert_true(view_surface_reserve(s, grid, 12 * n * n));
    for (int i = 0; i < grid; i++) {
        int at[3] = {i % side, i / side % side, i / side / side};
        bool outside = false;
        for (int k = 0; k < 3; k++) outside = outside || at[k] == 0 || at[k] == n;
        number[i] = outside ? vertices : -1;
        if (!outside) continue;
        float p[3], length = 0;
        for (int k = 0; k < 3; k++) p[k] = 2 * (float)at[k] / (float)n - 1, length += p[k] * p[k];
        for (int k = 0; k < 3; k++) s->vertex_m[3 * vertices + k] = round ? p[k] / sqrtf(length) : p[k];
        s->vertex_id[vertices] = vertices;
        vertices++;
    }
    for (int axis = 0; axis < 3; axis++)
        for (int end = 0; end < 2; end++)
            for (int i = 0; i < n * n; i++) {
                int corner[4];
                for (int c = 0; c < 4; c++) {
                    int at[3];
                    at[axis] = end * n;
                    at[(axis + 1) % 3] = i % n + (c == 1 || c == 2);
                    at[(axis + 2) % 3] = i / n + (c >= 2);
                    corner[c] = number[at[0] + side * (at[1] + side * at[2])];
                }
                int32_t two[6] = {corner[0], corner[1], corner[2], corner[0], corner[2], corner[3]};
                for (int t = 0; t < 2 && !end; t++) {
                    int32_t swap = two[3 * t + 1];
                    two[3 * t + 1] = two[3 * t + 2];
                    two[3 * t + 2] = swap;
                }
                memcpy(s->triangle + 3 * triangles, two, sizeof two);
                triangles += 2;
            }
    memset(s->kind, 0, (size_t)triangles);
    s->vertex_count = vertices, s->triangle_count = triangles;
    ++s->version, ++s->topology;
    free(number);
}

typedef struct edge {
    float end[6];
} edge;

static int by_bits(const void *a, const void *b) { return memcmp(a, b, sizeof(edge)); }

/* Every edge of the finest triangles occurs twice, by the exact positions of its ends: no gap of any size. */
static void assert_closed(view_skin *skin) {
    const view_vertex *v;
    const uint32_t *index;
    bool changed;
    view_skin_vertices(skin, &v);
    int32_t count = view_skin_indices(skin, &index, &changed);
    edge *edges = calloc((size_t)count, sizeof *edges);
    for (int32_t i = 0; i < count; i++) {
        const float *a = v[index[i]].at_m, *b = v[index[i % 3 == 2 ? i - 2 : i + 1]].at_m;
        bool swap = memcmp(a, b, 3 * sizeof *a) > 0;
        memcpy(edges[i].end, swap ? b : a, 3 * sizeof *a);
        memcpy(edges[i].end + 3, swap ? a : b, 3 * sizeof *a);
    }
    qsort(edges, (size_t)count, sizeof *edges, by_bits);
    for (int32_t i = 0; i < count; i += 2) assert_memory_equal(&edges[i], &edges[i + 1], sizeof *edges);
    free(edges);
}

static void sphere_is_closed_and_round(void **state) {
    (void)state;
    view_surface s = {0};
    box(&s, 4, true);
    /* Depth of straight edges' middles inside the sphere. */
    float flat = 0;
    for (int32_t i = 0; i < 3 * s.triangle_count; i++) {
        const float *a = s.vertex_m + 3 * s.triangle[i], *b = s.vertex_m + 3 * s.triangle[i % 3 == 2 ? i - 2 : i + 1];
        flat = fmaxf(flat, 1 - sqrtf((a[0] + b[0]) * (a[0] + b[0]) + (a[1] + b[1]) * (a[1] + b[1]) +
                                     (a[2] + b[2]) * (a[2] + b[2])) /
                                   2);
    }
    for (int levels = 0; levels <= 2; levels++) {
        view_skin *skin = view_skin_create(levels, 0.9f);
        assert_true(view_skin_update(skin, &s, 0.01f));
        assert_closed(skin);
        const view_vertex *v;
        int32_t count = view_skin_vertices(skin, &v);
        float worst = 0;
        for (int32_t i = 0; i < count; i++) {
            float r = sqrtf(v[i].at_m[0] * v[i].at_m[0] + v[i].at_m[1] * v[i].at_m[1] + v[i].at_m[2] * v[i].at_m[2]);
            worst = fmaxf(worst, fabsf(r - 1));
        }
        assert_true(worst < 0.25f * flat);
        view_skin_free(skin);
    }
    view_surface_free(&s);
}

static void cube_is_closed_and_sharp(void **state) {
    (void)state;
    view_surface s = {0};
    box(&s, 3, false);
    view_skin *skin = view_skin_create(2, 0.9f);
    assert_true(view_skin_update(skin, &s, 0.01f));
    assert_closed(skin);
    const view_vertex *v;
    int32_t count = view_skin_vertices(skin, &v);
    for (int32_t i = 0; i < count; i++) {
        /* On the cube, with the normal of one face. */
        float largest = 0, n1 = 0;
        for (int k = 0; k < 3; k++) {
            largest = fmaxf(largest, fabsf(v[i].at_m[k]));
            n1 += fabsf(v[i].normal[k]);
        }
        assert_float_equal(largest, 1, 1e-6);
        assert_float_equal(n1, 1, 1e-5);
    }
    view_skin_free(skin);
    view_surface_free(&s);
}

static void cut_surface_keeps_its_sharp_edge(void **state) {
    (void)state;
    view_surface s = {0};
    box(&s, 4, true);
    for (int32_t t = 0; t < 20; t++) s.kind[t] = 1;
    view_skin *skin = view_skin_create(1, 3.2f);
    assert_true(view_skin_update(skin, &s, 0.01f));
    const view_vertex *v;
    const uint32_t *index;
    bool changed;
    view_skin_vertices(skin, &v);
    int32_t count = view_skin_indices(skin, &index, &changed), opened = 0;
    assert_true(changed);
    assert_closed(skin);
    for (int32_t i = 0; i < count; i += 3) {
        assert_true(v[index[i]].kind == v[index[i + 1]].kind && v[index[i]].kind == v[index[i + 2]].kind);
        opened += v[index[i]].kind > 0.5f;
    }
    assert_int_equal(opened, 20 * 4);
    view_skin_free(skin);
    view_surface_free(&s);
}

/* A vertex that moves, and another one that a cut removes from the list, do not change the reference positions first
 * seen. */
static void reference_positions_survive_motion_and_cuts(void **state) {
    (void)state;
    view_surface s = {0};
    box(&s, 3, true);
    view_skin *skin = view_skin_create(0, 0.9f);
    assert_true(view_skin_update(skin, &s, 0.01f));
    float first[3];
    memcpy(first, s.vertex_m + 3 * s.triangle[0], sizeof first);
    int32_t id = s.vertex_id[s.triangle[0]];
    for (int32_t i = 0; i < 3 * s.vertex_count; i++) s.vertex_m[i] += 5;
    s.triangle_count -= 2;
    ++s.version, ++s.topology;
    assert_true(view_skin_update(skin, &s, 0.01f));
    const view_vertex *v;
    const uint32_t *index;
    bool changed;
    view_skin_vertices(skin, &v);
    view_skin_indices(skin, &index, &changed);
    assert_int_equal(s.vertex_id[s.triangle[0]], id);
    assert_memory_equal(v[index[0]].reference_m, first, sizeof first);
    assert_float_equal(v[index[0]].at_m[0], first[0] + 5, 1e-5);
    view_skin_free(skin);
    view_surface_free(&s);
}

static void empty_surface_is_handled(void **state) {
    (void)state;
    view_surface s = {0};
    assert_true(view_surface_reserve(&s, 1, 1));
    s.version = s.topology = 1;
    view_skin *skin = view_skin_create(1, 0.9f);
    assert_true(view_skin_update(skin, &s, 0.01f));
    const view_vertex *v;
    assert_int_equal(view_skin_vertices(skin, &v), 0);
    view_skin_free(skin);
    view_surface_free(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_is_closed_and_round), cmocka_unit_test(cube_is_closed_and_sharp),
        cmocka_unit_test(cut_surface_keeps_its_sharp_edge),
        cmocka_unit_test(reference_positions_survive_motion_and_cuts), cmocka_unit_test(empty_surface_is_handled)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
