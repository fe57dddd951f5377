/* Closest points of a point and a triangle, and of two segments. */
#include "touch/touch_internal.h"

#include "base/vec.h"

static void on_segment(const double p[3], const double a[3], const double b[3], int i, int j, tm_touch_closest *best) {
    double ab[3], ap[3], off[3];
    vsub(b, a, ab);
    vsub(p, a, ap);
    const double length2 = vdot(ab, ab), t = length2 > 0 ? law_clamp(vdot(ap, ab) / length2, 0, 1) : 0;
    vmadd(ap, -t, ab, off);
    const double distance = vnorm(off);
    if (!(distance < best->distance_m)) return;
    *best = (tm_touch_closest){.distance_m = distance};
    best->weight[i] = 1 - t, best->weight[j] = t;
    vset(off, best->offset);
}

tm_touch_closest tm_touch_point_triangle(const double p[3], const double a[3], const double b[3], const double c[3]) {
    double ab[3], ac[3], ap[3], n[3], cross[3];
    vsub(b, a, ab);
    vsub(c, a, ac);
    vsub(p, a, ap);
    vcross(ab, ac, n);
    const double nn = vdot(n, n);
    vcross(ap, ac, cross);
    const double s = nn > 0 ? vdot(cross, n) / nn : -1;
    vcross(ab, ap, cross);
    const double t = nn > 0 ? vdot(cross, n) / nn : -1;
    if (s >= 0 && t >= 0 && s + t <= 1) {
        tm_touch_closest inside = {.weight = {law_max(1 - s - t, 0), s, t}, .inside = true};
        vscale(vdot(ap, n) / nn, n, inside.offset);
        inside.distance_m = vnorm(inside.offset);
        return inside;
    }
    tm_touch_closest best = {.distance_m = INFINITY};
    on_segment(p, a, b, 0, 1, &best);
    on_segment(p, b, c, 1, 2, &best);
    on_segment(p, c, a, 2, 0, &best);
    return best;
}

double tm_touch_segments(const double a0[3], const double a1[3], const double b0[3], const double b1[3], double *s,
                         double *t, bool *inside) {
    double da[3], db[3], r[3];
    vsub(a1, a0, da);
    vsub(b1, b0, db);
    vsub(a0, b0, r);
    const double a = vdot(da, da), e = vdot(db, db), f = vdot(db, r), c = vdot(da, r), b = vdot(da, db);
    const double det = a * e - b * b;
    *inside = false;
    double x = 0, y = 0;
    if (det > 2.5e-3 * a * e) { /* not parallel: sin above 0.05 */
        x = (b * f - c * e) / det, y = (a * f - b * c) / det;
        *inside = x > 0 && x < 1 && y > 0 && y < 1;
    }
    if (!*inside) { /* Ericson, Real-Time Collision Detection, 5.1.9 */
        x = det > 0 ? law_clamp((b * f - c * e) / det, 0, 1) : e > 0 || !(a > 0) ? 0 : law_clamp(-c / a, 0, 1);
        y = e > 0 ? (b * x + f) / e : 0;
        if (y < 0)
            y = 0, x = a > 0 ? law_clamp(-c / a, 0, 1) : 0;
        else if (y > 1)
            y = 1, x = a > 0 ? law_clamp((b - c) / a, 0, 1) : 0;
    }
    *s = x, *t = y;
    vmadd(r, x, da, r);
    vmadd(r, -y, db, r);
    return vnorm(r);
}
