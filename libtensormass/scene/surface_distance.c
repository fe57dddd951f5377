/* Distance of spheres and points from triangles. A sphere's travel to a triangle is the shortest to its face, edges and
 * corners, each in closed form: Ericson, Real-Time Collision Detection (2005), 5.3 and 5.5. */
#include "surface_distance.h"

#include <math.h>

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"
typedef const double *vec;

/* Computes the nearest point of a triangle, as weights of its corners; Ericson 5.1.5. */
static void nearest(vec p, vec a, vec b, vec c, double out[3]) {
    double ab[3], ac[3], ap[3], bp[3], cp[3], v, w;
    vsub(b, a, ab);
    vsub(c, a, ac);
    vsub(p, a, ap);
    vsub(p, b, bp);
    vsub(p, c, cp);
    double d1 = vdot(ab, ap), d2 = vdot(ac, ap), d3 = vdot(ab, bp), d4 = vdot(ac, bp), d5 = vdot(ab, cp),
           d6 = vdot(ac, cp);
    double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    if (d1 <= 0 && d2 <= 0)
        v = 0, w = 0;
    else if (d3 >= 0 && d4 <= d3)
        v = 1, w = 0;
    else if (vc <= 0 && d1 >= 0 && d3 <= 0)
        v = d1 / (d1 - d3), w = 0;
    else if (d6 >= 0 && d5 <= d6)
        v = 0, w = 1;
    else if (vb <= 0 && d2 >= 0 && d6 <= 0)
        v = 0, w = d2 / (d2 - d6);
    else if (va <= 0 && d4 >= d3 && d5 >= d6)
        w = (d4 - d3) / (d4 - d3 + d5 - d6), v = 1 - w;
    else
        v = vb / (va + vb + vc), w = vc / (va + vb + vc);
    for (int k = 0; k < 3; k++) out[k] = a[k] + v * ab[k] + w * ac[k];
}

static double distance(vec p, vec a, vec b, vec c) {
    double q[3], d[3];
    nearest(p, a, b, c, q);
    vsub(p, q, d);
    return sqrt(vdot(d, d));
}

/* Returns the smaller root of |m + t d| = r, or infinity. */
static double reach(vec m, vec d, double radius_m) {
    double a = vdot(d, d), b = vdot(m, d), c = vdot(m, m) - radius_m * radius_m, under = b * b - a * c;
    if (!(a > 1e-30) || under < 0) return INFINITY;
    double t = (-b - sqrt(under)) / a;
    return t >= 0 ? t : INFINITY;
}

static double way_to_corner(vec from, vec along, vec a, double radius_m) {
    double m[3];
    vsub(from, a, m);
    return reach(m, along, radius_m);
}

/* Treats the edge as a line seen along its direction; a hit counts only between the ends. */
static double way_to_edge(vec from, vec along, vec a, vec b, double radius_m) {
    double e[3], m[3], flat_m[3], flat_d[3];
    vsub(b, a, e);
    vsub(from, a, m);
    double ee = vdot(e, e), me = vdot(m, e) / ee, de = vdot(along, e) / ee;
    for (int k = 0; k < 3; k++) {
        flat_m[k] = m[k] - me * e[k];
        flat_d[k] = along[k] - de * e[k];
    }
    double t = reach(flat_m, flat_d, radius_m), s = me + t * de;
    return isfinite(t) && s >= 0 && s <= 1 ? t : INFINITY;
}

static double way_to_face(vec from, vec along, vec a, vec b, vec c, double radius_m) {
    double e[3], f[3], n[3], m[3], q[3];
    vsub(b, a, e);
    vsub(c, a, f);
    vcross(e, f, n);
    double length = sqrt(vdot(n, n)), sign;
    vsub(from, a, m);
    if (!(length > 0)) return INFINITY;
    for (int k = 0; k < 3; k++) n[k] /= length;
    sign = vdot(n, m) < 0 ? -1 : 1;
    double t = (sign * radius_m - vdot(n, m)) / vdot(n, along);
    if (!(t >= 0) || !isfinite(t)) return INFINITY;
    for (int k = 0; k < 3; k++) q[k] = from[k] + t * along[k] - sign * radius_m * n[k];
    return distance(q, a, b, c) <= 1e-9 * sqrt(length) ? t : INFINITY;
}

double sim_way_to_touch(const tm_mesh *mesh, const double from_m[3], const double along[3], double radius_m) {
    double way = INFINITY;
    for (int32_t t = 0; t < mesh->surface_count; t++) {
        vec p[3];
        for (int k = 0; k < 3; k++) p[k] = &mesh->rest_m[3 * mesh->surface[3 * t + k]];
        if (distance(from_m, p[0], p[1], p[2]) <= radius_m) return 0;
        way = fmin(way, way_to_face(from_m, along, p[0], p[1], p[2], radius_m));
        for (int k = 0; k < 3; k++) {
            way = fmin(way, way_to_edge(from_m, along, p[k], p[(k + 1) % 3], radius_m));
            way = fmin(way, way_to_corner(from_m, along, p[k], radius_m));
        }
    }
    return isfinite(way) ? way : -1;
}

double sim_surface_distance(const sim *s, const double point_m[3]) {
    tm_surface_view surface = sim_surface(s);
    const double *u = sim_displacement(s), *rest = s->mesh->rest_m;
    double least = INFINITY;
    for (int32_t t = 0; t < surface.count; t++) {
        double p[3][3];
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) {
                int32_t i = 3 * surface.triangle[3 * t + k] + a;
                p[k][a] = rest[i] + u[i];
            }
        least = fmin(least, distance(point_m, p[0], p[1], p[2]));
    }
    return least;
}

double sim_body_distance(const tm_mesh *mesh, const int32_t *tet_body, int32_t body, const double point_m[3]) {
    double least = INFINITY;
    for (int32_t t = 0; t < mesh->surface_count; t++) {
        vec p[3];
        if (tet_body[mesh->surface_face[t] / 4] != body) continue;
        for (int k = 0; k < 3; k++) p[k] = &mesh->rest_m[3 * mesh->surface[3 * t + k]];
        least = fmin(least, distance(point_m, p[0], p[1], p[2]));
    }
    return least;
}

bool sim_is_in_tet(const tm_mesh *mesh, int32_t tet, const double point_m[3]) {
    static const int face[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}}; /* normal inward */
    bool inside = true;
    for (int f = 0; f < 4 && inside; f++) {
        double e[3], g[3], m[3], n[3];
        vec a = &mesh->rest_m[3 * mesh->tet[4 * tet + face[f][0]]];
        vsub(&mesh->rest_m[3 * mesh->tet[4 * tet + face[f][1]]], a, e);
        vsub(&mesh->rest_m[3 * mesh->tet[4 * tet + face[f][2]]], a, g);
        vsub(point_m, a, m);
        vcross(e, g, n);
        inside = vdot(n, m) >= 0;
    }
    return inside;
}

bool sim_is_inside(const tm_mesh *mesh, const double point_m[3]) {
    bool inside = false;
    for (int32_t t = 0; t < mesh->tet_count && !inside; t++) inside = sim_is_in_tet(mesh, t, point_m);
    return inside;
}
