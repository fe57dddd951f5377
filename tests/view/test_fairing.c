/* The drawn wall of a cut: smoother than the tetrahedra's faces by a given factor, close to them, without gaps, its
 * outline on the outer surface, one wall through all regions; and no wall without a cut. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "view/fairing.h"
#include "view/surface_smoothing.h"

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"

enum { N = 10, SIDE = N + 1, TETS = 6 * N * N * N };

typedef struct face {
    int32_t key[3], corner[3]; /* ascending; outward */
    int32_t tet;
} face;

static int by_corners(const void *a, const void *b) {
    const face *p = a, *q = b;
    for (int k = 0; k < 3; k++)
        if (p->key[k] != q->key[k]) return p->key[k] < q->key[k] ? -1 : 1;
    return p->tet - q->tet;
}

static int32_t grid(const int at[3]) { return at[0] + SIDE * (at[1] + SIDE * at[2]); }

/* A unit block of N*N*N cubes of six tetrahedra each. */
static void tetrahedra(int32_t tet[][4], float middle[][3]) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    static const bool turned[6] = {false, true, true, false, false, true};
    for (int i = 0; i < TETS; i++) {
        int at[3] = {i / 6 % N, i / 6 / N % N, i / 6 / N / N};
        for (int k = 0; k < 3; k++) middle[i][k] = 0;
        for (int c = 0; c < 4; c++) {
            if (c) at[order[i % 6][c - 1]]++;
            tet[i][turned[i % 6] && c >= 2 ? 5 - c : c] = grid(at);
            for (int k = 0; k < 3; k++) middle[i][k] += (float)at[k] / (4 * N);
        }
    }
}

static bool gone(const float middle[3]) {
    const float away[3] = {middle[0] - 0.5f, middle[1] - 0.5f, middle[2] - 1};
    return vnorm(away) < 0.33f;
}

/* Makes the block with a bowl cut out of its top, in two regions along x; with `cut` false, uncut. */
static void bowl(view_surface *s, bool cut) {
    static const int outward[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    static int32_t tet[TETS][4];
    static float middle[TETS][3];
    face *f = malloc(4 * TETS * sizeof *f);
    int32_t number[SIDE * SIDE * SIDE];
    tetrahedra(tet, middle);
    for (int i = 0; i < 4 * TETS; i++) {
        f[i].tet = i / 4;
        for (int k = 0; k < 3; k++) {
            int at = k;
            f[i].corner[k] = tet[i / 4][outward[i % 4][k]];
            for (; at > 0 && f[i].key[at - 1] > f[i].corner[k]; at--) f[i].key[at] = f[i].key[at - 1];
            f[i].key[at] = f[i].corner[k];
        }
    }
    qsort(f, 4 * TETS, sizeof *f, by_corners);
    memset(number, -1, sizeof number);
    assert_true(view_surface_reserve(s, SIDE * SIDE * SIDE, 4 * TETS));
    for (int i = 0; i < 4 * TETS; i++) {
        const bool paired = (i && !memcmp(f[i].key, f[i - 1].key, sizeof f->key)) ||
                            (i + 1 < 4 * TETS && !memcmp(f[i].key, f[i + 1].key, sizeof f->key));
        const int32_t other = !paired                                               ? -1
                              : i && !memcmp(f[i].key, f[i - 1].key, sizeof f->key) ? f[i - 1].tet
                                                                                    : f[i + 1].tet;
        const bool open = other >= 0 && cut && gone(middle[other]);
        if ((cut && gone(middle[f[i].tet])) || (other >= 0 && !open)) continue;
        for (int k = 0; k < 3; k++) {
            const int32_t v = f[i].corner[k];
            if (number[v] < 0) {
                number[v] = s->vertex_count++;
                s->vertex_id[number[v]] = v;
                const int at[3] = {v % SIDE, v / SIDE % SIDE, v / SIDE / SIDE};
                for (int a = 0; a < 3; a++) s->vertex_m[3 * number[v] + a] = (float)at[a] / N;
            }
            s->triangle[3 * s->triangle_count + k] = number[v];
        }
        s->kind[s->triangle_count++] = (uint8_t)(view_kind_of(middle[f[i].tet][0] > 0.5f) | open);
    }
    ++s->version, ++s->topology;
    free(f);
}

typedef struct edge {
    float end[6];
    int32_t triangle;
} edge;

static int by_bits(const void *a, const void *b) { return memcmp(a, b, 6 * sizeof(float)); }

static edge *edges_of(const float *at, const uint32_t *index, int32_t count) {
    edge *out = calloc((size_t)count, sizeof *out);
    for (int32_t i = 0; i < count; i++) {
        const float *a = at + 3 * index[i], *b = at + 3 * index[i % 3 == 2 ? i - 2 : i + 1];
        const bool swap = memcmp(a, b, 3 * sizeof *a) > 0;
        memcpy(out[i].end, swap ? b : a, 3 * sizeof *a);
        memcpy(out[i].end + 3, swap ? a : b, 3 * sizeof *a);
        out[i].triangle = i / 3;
    }
    qsort(out, (size_t)count, sizeof *out, by_bits);
    return out;
}

static void normal_of(const float *at, const int32_t *corner, float out[3]) {
    float a[3], b[3];
    vsub(at + 3 * corner[1], at + 3 * corner[0], a), vsub(at + 3 * corner[2], at + 3 * corner[0], b);
    vcross(a, b, out);
    vunit(out, out);
}

/* Returns the root mean square angle between neighbours in the wall, radians. */
static float roughness(const view_surface *s, const float *at) {
    edge *e = edges_of(s->vertex_m, (const uint32_t *)s->triangle, 3 * s->triangle_count);
    float sum = 0, count = 0;
    for (int32_t i = 0; i < 3 * s->triangle_count; i += 2) {
        const int32_t a = e[i].triangle, b = e[i + 1].triangle;
        if (!(s->kind[a] & s->kind[b] & 1)) continue;
        float m[3], n[3];
        normal_of(at, s->triangle + 3 * a, m), normal_of(at, s->triangle + 3 * b, n);
        const float angle = acosf(fminf(1, fmaxf(-1, vdot(m, n))));
        sum += angle * angle, count++;
    }
    free(e);
    assert_true(count > 200);
    return sqrtf(sum / count);
}

static view_skin *skin_of(const view_surface *s, int levels) {
    view_skin *skin = view_skin_create(levels, 0.9f);
    assert_true(view_skin_update(skin, s, 0.01f));
    return skin;
}

static void the_wall_is_smooth_and_near(void **state) {
    (void)state;
    view_surface s = {0};
    bowl(&s, true);
    view_skin *skin = skin_of(&s, 1);
    const float *at = view_skin_places(skin), before = roughness(&s, s.vertex_m), after = roughness(&s, at);
    float farthest = 0;
    for (int32_t v = 0; v < s.vertex_count; v++) {
        float d[3];
        vsub(at + 3 * v, s.vertex_m + 3 * v, d);
        farthest = fmaxf(farthest, vnorm(d));
    }
    print_message("roughness %.1f -> %.1f degrees, farthest %.2f of a cube's side\n", 57.3 * (double)before,
                  57.3 * (double)after, (double)farthest * N);
    assert_true(after < 0.3f * before);
    assert_true(farthest > 0.1f / N && farthest < VIEW_FAIRING_REACH * 1.75f / N);
    view_skin_free(skin);
    view_surface_free(&s);
}

static void outline_stays_on_the_outer_surface_without_a_gap(void **state) {
    (void)state;
    view_surface s = {0};
    bowl(&s, true);
    bool *wall = calloc((size_t)s.vertex_count, sizeof *wall), *outer = calloc((size_t)s.vertex_count, sizeof *outer);
    for (int32_t c = 0; c < 3 * s.triangle_count; c++) (s.kind[c / 3] & 1 ? wall : outer)[s.triangle[c]] = true;
    for (int levels = 0; levels <= 2; levels++) {
        view_skin *skin = skin_of(&s, levels);
        const float *at = view_skin_places(skin);
        int32_t slid = 0;
        for (int32_t v = 0; v < s.vertex_count; v++) {
            const float *was = s.vertex_m + 3 * v, *is = at + 3 * v;
            if (!wall[v]) assert_memory_equal(was, is, 3 * sizeof *is);
            if (wall[v] && outer[v]) assert_float_equal(is[2], 1, 1e-6), slid += memcmp(was, is, 3 * sizeof *is) != 0;
        }
        assert_true(slid > 10);
        for (int32_t t = 0; t < s.triangle_count; t++) { /* the outer surface is not folded over */
            float was[3], is[3];
            normal_of(s.vertex_m, s.triangle + 3 * t, was), normal_of(at, s.triangle + 3 * t, is);
            if (!(s.kind[t] & 1)) assert_true(vdot(was, is) > 0.9f);
        }
        const view_vertex *vertex;
        const uint32_t *index;
        bool changed;
        const int32_t vertices = view_skin_vertices(skin, &vertex), count = view_skin_indices(skin, &index, &changed);
        float *drawn = malloc(3 * (size_t)vertices * sizeof *drawn);
        for (int32_t v = 0; v < vertices; v++) vset(vertex[v].at_m, drawn + 3 * v);
        edge *e = edges_of(drawn, index, count);
        for (int32_t i = 0; i < count; i += 2) assert_memory_equal(e[i].end, e[i + 1].end, sizeof e->end);
        for (int32_t i = 0; i < count; i += 3) { /* nor is the drawn outline */
            const int32_t corner[3] = {(int32_t)index[i], (int32_t)index[i + 1], (int32_t)index[i + 2]};
            float n[3], top = 1;
            for (int k = 0; k < 3; k++) top = fminf(top, drawn[3 * corner[k] + 2]);
            normal_of(drawn, corner, n);
            if (!((int)vertex[index[i]].kind & 1) && top > 1 - 1e-6f) assert_true(n[2] > 0.5f);
        }
        free(e);
        free(drawn);
        view_skin_free(skin);
    }
    free(wall);
    free(outer);
    view_surface_free(&s);
}

/* Returns the largest angle between consecutive edges of the drawn outline, radians; `longest`: of its edges. */
static float largest_turn(const view_surface *s, int levels, float *longest) {
    view_skin *skin = skin_of(s, levels);
    const view_vertex *v;
    const uint32_t *index;
    bool changed;
    const int32_t vertices = view_skin_vertices(skin, &v), count = view_skin_indices(skin, &index, &changed);
    float *drawn = malloc(3 * (size_t)vertices * sizeof *drawn), largest = 0;
    for (int32_t i = 0; i < vertices; i++) vset(v[i].at_m, drawn + 3 * i);
    edge *e = edges_of(drawn, index, count), *rim = malloc((size_t)count * sizeof *rim);
    int32_t pieces = 0;
    for (int32_t i = 0; i < count; i += 2) {
        const int a = (int)v[index[3 * e[i].triangle]].kind, b = (int)v[index[3 * e[i + 1].triangle]].kind;
        if (!((a ^ b) & 1)) continue;
        rim[pieces++] = e[i];
        for (int end = 0; end < 2; end++) assert_float_equal(e[i].end[3 * end + 2], 1, 1e-6); /* the block's top */
    }
    *longest = 0;
    for (int32_t i = 0; i < pieces; i++)
        for (int32_t j = 0; j < i; j++)
            for (int k = 0; k < 4; k++) { /* whose ends meet */
                float a[3], b[3];
                if (memcmp(rim[i].end + 3 * (k & 1), rim[j].end + 3 * (k >> 1), 3 * sizeof *a) != 0) continue;
                vsub(rim[i].end + 3 * (k & 1), rim[i].end + 3 * !(k & 1), a);
                vsub(rim[j].end + 3 * !(k >> 1), rim[j].end + 3 * (k >> 1), b);
                *longest = fmaxf(*longest, vnorm(a));
                largest = fmaxf(largest, acosf(fminf(1, vdot(a, b) / (vnorm(a) * vnorm(b)))));
            }
    assert_true(pieces > 20);
    free(e);
    free(rim);
    free(drawn);
    view_skin_free(skin);
    return largest;
}

static void outline_of_the_cut_is_smooth(void **state) {
    (void)state;
    view_surface s = {0};
    bowl(&s, true);
    float piece[3], turn[3];
    for (int levels = 0; levels <= 2; levels++) turn[levels] = largest_turn(&s, levels, &piece[levels]);
    print_message(
        "the rim turns by %.1f, %.1f, %.1f degrees at most, in pieces of up to %.2f, %.2f, %.2f of a cube's side\n",
        57.3 * (double)turn[0], 57.3 * (double)turn[1], 57.3 * (double)turn[2], (double)piece[0] * N,
        (double)piece[1] * N, (double)piece[2] * N);
    for (int levels = 1; levels <= 2; levels++) {
        assert_true(turn[levels] < 0.8f * turn[levels - 1]);
        assert_true(piece[levels] < 0.7f * piece[levels - 1]);
    }
    view_surface_free(&s);
}

/* Where two regions meet in the wall there is one normal, and two colours. */
static void one_wall_through_both_regions(void **state) {
    (void)state;
    view_surface s = {0};
    bowl(&s, true);
    view_skin *skin = skin_of(&s, 0);
    const view_vertex *v;
    const uint32_t *index;
    bool changed;
    view_skin_vertices(skin, &v);
    view_skin_indices(skin, &index, &changed);
    int32_t *sector[2] = {malloc((size_t)s.vertex_count * sizeof **sector),
                          malloc((size_t)s.vertex_count * sizeof **sector)};
    int32_t shared = 0;
    for (int r = 0; r < 2; r++) memset(sector[r], -1, (size_t)s.vertex_count * sizeof **sector);
    for (int32_t c = 0; c < 3 * s.triangle_count; c++) {
        assert_true(v[index[c]].kind == (float)s.kind[c / 3]);
        if (s.kind[c / 3] & 1) sector[s.kind[c / 3] / 2][s.triangle[c]] = (int32_t)index[c];
    }
    for (int32_t i = 0; i < s.vertex_count; i++) {
        if (sector[0][i] < 0 || sector[1][i] < 0) continue;
        assert_memory_equal(v[sector[0][i]].normal, v[sector[1][i]].normal, sizeof v->normal);
        shared++;
    }
    assert_true(shared > 5);
    for (int r = 0; r < 2; r++) free(sector[r]);
    view_skin_free(skin);
    view_surface_free(&s);
}

static void uncut_surface_is_unchanged(void **state) {
    (void)state;
    for (int planed = 0; planed < 2; planed++) {
        view_surface s = {0};
        bowl(&s, planed);
        s.planed = planed;
        view_skin *skin = skin_of(&s, 0);
        assert_memory_equal(view_skin_places(skin), s.vertex_m, 3 * (size_t)s.vertex_count * sizeof(float));
        view_skin_free(skin);
        view_surface_free(&s);
    }
}

/* The tissue is rotated and moved, then cut: the wall moves with it, and its texture is as at rest. */
static void wall_moves_with_the_tissue(void **state) {
    (void)state;
    view_surface whole = {0}, s = {0};
    bowl(&whole, false), bowl(&s, true);
    s.version = whole.version + 1, s.topology = whole.topology + 1;
    view_skin *rest = skin_of(&s, 0), *moved = skin_of(&whole, 0);
    for (int32_t v = 0; v < s.vertex_count; v++) {
        const float x = s.vertex_m[3 * v], y = s.vertex_m[3 * v + 1];
        s.vertex_m[3 * v] = 3 + x - 0.01f * y, s.vertex_m[3 * v + 1] = y + 0.01f * x;
    }
    s.version++;
    assert_true(view_skin_update(moved, &s, 0.01f));
    const float *at = view_skin_places(rest), *now = view_skin_places(moved);
    for (int32_t v = 0; v < s.vertex_count; v++) {
        assert_float_equal(now[3 * v], 3 + at[3 * v] - 0.01f * at[3 * v + 1], 2e-4);
        assert_float_equal(now[3 * v + 1], at[3 * v + 1] + 0.01f * at[3 * v], 2e-4);
    }
    const view_vertex *a, *b;
    const int32_t count = view_skin_vertices(rest, &a);
    assert_int_equal(count, view_skin_vertices(moved, &b));
    for (int32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) assert_float_equal(a[i].reference_m[k], b[i].reference_m[k], 0.005);
    view_skin_free(rest);
    view_skin_free(moved);
    view_surface_free(&whole);
    view_surface_free(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(outline_of_the_cut_is_smooth),
                                       cmocka_unit_test(the_wall_is_smooth_and_near),
                                       cmocka_unit_test(outline_stays_on_the_outer_surface_without_a_gap),
                                       cmocka_unit_test(one_wall_through_both_regions),
                                       cmocka_unit_test(uncut_surface_is_unchanged),
                                       cmocka_unit_test(wall_moves_with_the_tissue)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
