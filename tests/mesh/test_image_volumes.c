/* Labels have the volumes of their voxels, to 2e-5 of each, and no tetrahedron is worse than the worst at the start. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "mesh/image.h"
#include "mesh/mesh_builder.h"

#define LAW_REAL double
#include "libtensormass/numeric/random.h"
#include "libtensormass/numeric/vec.h"

enum { N = 8, SIDE = N + 1, TETS = 6 * N * N * N };

/* Makes a unit block of cubes of six tetrahedra each with displaced vertices: a ball of label 2 with a core of label
 * 3 in label 1. */
static image_tets block(void) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    static const bool turned[6] = {false, true, true, false, false, true};
    image_tets m = {SIDE * SIDE * SIDE, TETS, malloc(3 * SIDE * SIDE * SIDE * sizeof(double)),
                    malloc(4 * TETS * sizeof(int)), malloc(TETS * sizeof(int))};
    unsigned dice = 1;
    for (int i = 0; i < 3 * m.vertices; i++) {
        const int at = i % 3 == 0 ? i / 3 % SIDE : i % 3 == 1 ? i / 3 / SIDE % SIDE : i / 3 / SIDE / SIDE;
        m.vertex_m[i] = (at + 0.2 * ((double)(num_random32(&dice) >> 8) / 16777216 - 0.5)) / N;
    }
    for (int t = 0; t < TETS; t++) {
        int at[3] = {t / 6 % N, t / 6 / N % N, t / 6 / N / N};
        double away[3] = {-2, -2, -2};
        for (int c = 0; c < 4; c++) {
            if (c) at[order[t % 6][c - 1]]++;
            const int v = at[0] + SIDE * (at[1] + SIDE * at[2]);
            m.tet[4 * t + (turned[t % 6] && c >= 2 ? 5 - c : c)] = v;
            for (int k = 0; k < 3; k++) away[k] += m.vertex_m[3 * v + k];
        }
        const double radius = sqrt(vdot(away, away)) / 4;
        m.label[t] = radius < 0.15 ? 3 : radius < 0.35 ? 2 : 1;
    }
    return m;
}

static void corners(const image_tets *m, int t, const double *p[4]) {
    for (int k = 0; k < 4; k++) p[k] = m->vertex_m + 3 * m->tet[4 * t + k];
}

static double volume(const double *const p[4]) {
    double u[3], v[3], w[3], n[3];
    vsub(p[1], p[0], u);
    vsub(p[2], p[0], v);
    vsub(p[3], p[0], w);
    vcross(u, v, n);
    return vdot(n, w) / 6;
}

/* Returns the dihedral angle at edge a-b to the other two corners, for each edge. */
static double dihedral(const double *a, const double *b, const double *c, const double *d) {
    double e[3], u[3], w[3], m[3], n[3];
    vsub(b, a, e);
    vsub(c, a, u);
    vsub(d, a, w);
    vcross(e, u, m);
    vcross(e, w, n);
    return acos(vdot(m, n) / sqrt(vdot(m, m) * vdot(n, n)));
}

typedef struct figures {
    double volume_m3[5], size_m, angle;
} figures;

static figures look(const image_tets *m) {
    static const int pair[6][4] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2}, {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};
    figures out = {.size_m = INFINITY, .angle = INFINITY};
    for (int t = 0; t < m->tets; t++) {
        const double *p[4];
        corners(m, t, p);
        out.volume_m3[m->label[t]] += volume(p);
        out.size_m = fmin(out.size_m, growing_tet_size(p[0], p[1], p[2], p[3]));
        for (int e = 0; e < 6; e++)
            out.angle = fmin(out.angle, dihedral(p[pair[e][0]], p[pair[e][1]], p[pair[e][2]], p[pair[e][3]]));
    }
    return out;
}

/* Checks the volumes; `wanted` and `got` are relative to the label's volume in the mesh before. */
static void fit(const double wanted[4], double got[4]) {
    static label_field field;
    image_tets m = block();
    const figures was = look(&m);
    field = (label_field){.labels = 4, .spacing_m = {1e-3, 1e-3, 1e-3}};
    for (int l = 1; l <= 3; l++) field.voxels[l] = (int64_t)(1e9 * wanted[l] * was.volume_m3[l]);
    field.voxels[4] = 1000; /* a label that the mesh does not contain */
    assert_true(image_fit_volumes(&field, &m));
    const figures is = look(&m);
    for (int l = 1; l <= 3; l++) got[l] = is.volume_m3[l] / was.volume_m3[l];
    assert_true(is.size_m >= was.size_m * (1 - 1e-12) && is.angle >= was.angle - 1e-9);
    free(m.vertex_m);
    free(m.tet);
    free(m.label);
}

static void test_labels_reach_their_volumes(void **state) {
    static const double wanted[3][4] = {{0, 1, 1.1, 1.2}, {0, 0.97, 0.9, 1.3}, {0, 1.05, 1, 0.8}};
    (void)state;
    for (int i = 0; i < 3; i++) {
        double got[4];
        fit(wanted[i], got);
        for (int l = 1; l <= 3; l++) assert_true(fabs(got[l] / wanted[i][l] - 1) < 2.1e-5);
    }
}

/* A core three times as large is more than its tetrahedra permit: it grows as far as possible, and its neighbours
 * get their volumes. */
static void test_unreachable_volume_leaves_other_labels_exact(void **state) {
    double got[4];
    (void)state;
    fit((const double[4]){0, 1, 1, 3}, got);
    assert_true(got[3] > 1.4 && got[3] < 2.9);
    assert_true(fabs(got[1] - 1) < 1e-4 && fabs(got[2] - 1) < 1e-4);
    fit((const double[4]){0, 0.6, 2.5, 1}, got);
    assert_true(got[1] < 0.8 && got[2] > 1.1 && fabs(got[3] - 1) < 1e-4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_labels_reach_their_volumes),
        cmocka_unit_test(test_unreachable_volume_leaves_other_labels_exact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
