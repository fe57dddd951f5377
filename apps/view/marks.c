/* Supports, ties and fibres as triangles on the deformed tissue. */
#include <math.h>
#include <string.h>

#include "shapes.h"

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"
static const int32_t XYZ = 3;

/* Appends an octahedron. */
static void ball(view_shape *s, const float at_m[3], float radius_m) {
    for (int side = 0; side < 8; side++) {
        float corner[3][3] = {{0}}, normal[3];
        int turned = (side & 1) ^ (side >> 1 & 1) ^ (side >> 2 & 1);
        for (int k = 0; k < 3; k++) {
            float sign = side >> k & 1 ? -1.0f : 1.0f;
            normal[k] = sign * 0.57735f;
            corner[k][k] = sign * radius_m;
        }
        for (int c = 0; c < 3; c++) {
            int k = turned && c ? 3 - c : c;
            for (int a = 0; a < 3; a++) corner[k][a] += at_m[a];
            view_shape_point(s, corner[k], normal, VIEW_PAINT_SUPPORT);
        }
    }
}

void view_shape_supports(view_shape *s, const view_marks *m, const view_surface *surface, float radius_m) {
    if (!m->support_of) return;
    for (int32_t i = 0; i < surface->vertex_count; i++)
        if (surface->vertex_id[i] < m->vertex_count && m->support_of[surface->vertex_id[i]])
            ball(s, surface->vertex_m + XYZ * i, radius_m);
}

void view_shape_ties(view_shape *s, const view_ties *ties, float radius_m) {
    for (int32_t i = 0; i < ties->count; i++)
        view_shape_strand(s, ties->end_m + 2 * XYZ * i, ties->end_m + 2 * XYZ * i + XYZ, radius_m, VIEW_PAINT_TIE);
}

/* Computes the fibre at rest as shares of two edges of the triangle, without its normal component. Returns false for a
 * degenerate triangle. */
static bool along_edges(const float e1[3], const float e2[3], const float fibre[3], float share[2]) {
    float a = vdot(e1, e1), b = vdot(e1, e2), c = vdot(e2, e2), f1 = vdot(fibre, e1), f2 = vdot(fibre, e2),
          det = a * c - b * b;
    if (!(det > 1e-12f * a * c)) return false;
    share[0] = (f1 * c - f2 * b) / det, share[1] = (f2 * a - f1 * b) / det;
    return true;
}

/* Appends a flat ribbon through the triangle's middle, as long as the fibre's tangential part. It is a little above the
 * triangle, because the smoothed surface is drawn rounder. */
static void ribbon(view_shape *s, const float corner[3][3], const float share[2]) {
    float e1[3], e2[3], middle[3], run[3], normal[3], across[3];
    for (int k = 0; k < 3; k++) {
        e1[k] = corner[1][k] - corner[0][k], e2[k] = corner[2][k] - corner[0][k];
        middle[k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3;
        run[k] = share[0] * e1[k] + share[1] * e2[k];
    }
    vcross(e1, e2, normal);
    float area = sqrtf(vdot(normal, normal)), size = sqrtf(area);
    if (!(area > 0)) return;
    for (int k = 0; k < 3; k++) normal[k] /= area;
    vcross(normal, run, across);
    float length = sqrtf(vdot(across, across));
    if (!(length > 0.05f)) return;
    float at[4][3];
    for (int k = 0; k < 3; k++) {
        float above = middle[k] + 0.07f * size * normal[k], half = 0.36f * size * run[k],
              wide = 0.035f * size * across[k] / length;
        at[0][k] = above - half - wide, at[1][k] = above + half - wide, at[2][k] = above + half + wide,
        at[3][k] = above - half + wide;
    }
    static const int order[6] = {0, 1, 2, 0, 2, 3};
    for (int i = 0; i < 6; i++) view_shape_point(s, at[order[i]], normal, VIEW_PAINT_FIBRE);
}

void view_shape_fibres(view_shape *s, const view_marks *m, const view_surface *surface) {
    for (int32_t t = 0; m->fibre && t < surface->triangle_count; t++) {
        const int32_t *v = surface->triangle + XYZ * t;
        int32_t id[3];
        float now[3][3], e1[3], e2[3], share[2];
        bool known = true;
        for (int c = 0; c < 3; c++) {
            id[c] = surface->vertex_id[v[c]];
            known = known && id[c] < m->vertex_count;
            memcpy(now[c], surface->vertex_m + XYZ * v[c], sizeof now[c]);
        }
        int32_t tet = known ? view_marks_tet(m, id) : -1;
        if (tet < 0) continue;
        for (int k = 0; k < 3; k++) {
            float from = m->rest_m[XYZ * id[0] + k];
            e1[k] = m->rest_m[XYZ * id[1] + k] - from, e2[k] = m->rest_m[XYZ * id[2] + k] - from;
        }
        if (along_edges(e1, e2, m->fibre + XYZ * tet, share)) ribbon(s, (const float(*)[3])now, share);
    }
}
