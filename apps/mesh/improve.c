/* Moves vertices to enlarge the smallest tetrahedron, which sets the time step of all. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/random.h"
#include "mesh_builder.h"

bool growing_fans_make(const growing *m, growing_fans *out) {
    growing_fans f = {calloc((size_t)m->vertex_count + 2, sizeof(int)), malloc(4 * (size_t)m->tet_count * sizeof(int))};
    *out = f;
    if (!f.begin || !f.tet) return false;
    for (int i = 0; i < 4 * m->tet_count; i++) f.begin[m->tet[i] + 2]++;
    for (int v = 0; v < m->vertex_count; v++) f.begin[v + 2] += f.begin[v + 1];
    for (int i = 0; i < 4 * m->tet_count; i++) f.tet[f.begin[m->tet[i] + 1]++] = i / 4;
    return true;
}

void growing_fans_free(growing_fans *f) {
    free(f->begin);
    free(f->tet);
}

/* Returns the sum of (scale/size)^6 over a vertex's tetrahedra: the worst dominates, the others still count. */
static double badness(const growing *m, const growing_fans *f, int v, double scale) {
    double sum = 0;
    for (int i = f->begin[v]; i < f->begin[v + 1]; i++) {
        const int *t = m->tet + 4 * (size_t)f->tet[i];
        double size =
            growing_tet_size(m->vertex + 3 * t[0], m->vertex + 3 * t[1], m->vertex + 3 * t[2], m->vertex + 3 * t[3]);
        if (size <= 1e-3 * scale) return 1e300;
        double ratio = scale / size;
        ratio *= ratio;
        sum += ratio * ratio * ratio;
    }
    return sum;
}

/* Returns whether none of the vertex's tetrahedra is one that must not arise (growing_hold.wanted). */
static bool allowed(const growing *m, const growing_fans *f, const growing_hold *h, int v) {
    for (int i = f->begin[v]; h && i < f->begin[v + 1]; i++)
        if (h->wanted(m, f->tet[i], growing_longest_edge_m(m, f->tet[i]), h->context)) return false;
    return true;
}

/* Reduces a direction to what the vertex may do: ALONG its held direction, or ACROSS it (in the plane normal to it). */
static void keep_to(const growing_hold *h, int v, double d[3]) {
    const double *n = h->direction + 3 * (size_t)v;
    double along = d[0] * n[0] + d[1] * n[1] + d[2] * n[2];
    for (int k = 0; k < 3; k++) {
        if (h->freedom[v] == ALONG) d[k] = along * n[k];
        if (h->freedom[v] == ACROSS) d[k] -= along * n[k];
    }
}

/* Tries the six directions of a rotated frame and keeps a better position. */
static void search(growing *m, const growing_fans *f, const growing_solid *b, const growing_hold *h, int v,
                   double scale, double step, unsigned *dice) {
    double *p = m->vertex + 3 * (size_t)v, best = badness(m, f, v, scale), axis[3][3], keep[3];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) {
            axis[k][i] = (double)(num_random32(dice) >> 8) / 8388608.0 - 1;
        }
    for (int k = 0; k < 6; k++) {
        double *d = axis[k / 2];
        if (h) keep_to(h, v, d);
        double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) + 1e-9;
        memcpy(keep, p, sizeof keep);
        for (int i = 0; i < 3; i++) p[i] += (k & 1 ? -step : step) * d[i] / length;
        if (b) b->project(b->shape, p);
        bool placed = !h || !h->settle || h->settle(h->shape, v, p);
        double now = placed ? badness(m, f, v, scale) : HUGE_VAL;
        if (now < best && allowed(m, f, h, v))
            best = now;
        else
            memcpy(p, keep, sizeof keep);
    }
}

void growing_improve(growing *m, const growing_solid *b, const growing_hold *h, int sweeps) {
    growing_fans f;
    if (m->no_memory) return;
    bool good = growing_fans_make(m, &f);
    double *size = malloc((size_t)m->tet_count * sizeof *size);
    unsigned char *outer = calloc((size_t)m->vertex_count + 1, 1);
    unsigned dice = 12345;
    if (!good || !size || !outer) m->no_memory = true;
    for (int i = 0; outer && i < 3 * m->face_count; i++) outer[m->face[i]] = 1;
    for (int sweep = 0; sweep < sweeps && !m->no_memory; sweep++) {
        double largest = 0;
        for (int t = 0; t < m->tet_count; t++) {
            const int *c = m->tet + 4 * (size_t)t;
            size[t] = growing_tet_size(m->vertex + 3 * c[0], m->vertex + 3 * c[1], m->vertex + 3 * c[2],
                                       m->vertex + 3 * c[3]);
            if (size[t] > largest) largest = size[t];
        }
        double step = 0.5 * largest * pow(0.02, (double)sweep / sweeps);
        for (int v = 0; v < m->vertex_count; v++) {
            bool poor = false;
            for (int i = f.begin[v]; i < f.begin[v + 1] && !poor; i++) poor = size[f.tet[i]] < 0.8 * largest;
            if (poor && !(h && h->freedom[v] == FIXED))
                search(m, &f, b && outer[v] ? b : NULL, h, v, largest, step, &dice);
        }
    }
    free(size);
    free(outer);
    growing_fans_free(&f);
}
