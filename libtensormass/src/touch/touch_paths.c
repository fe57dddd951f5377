/* Paths of vertices in a substep, which are straight, and when four of them are in a plane: the volume between them is
 * a cubic in the share of the substep. */
#include "touch/touch_paths.h"

#include <math.h>

#include "base/vec.h"

static double determinant(const double a[3], const double b[3], const double c[3]) {
    double cross[3];
    vcross(a, b, cross);
    return vdot(cross, c);
}

void tm_touch_volume(const tm_touching *t, const int32_t vertex[4], double cubic[4]) {
    double e[3][3], d[3][3], from[2][3];
    tm_touch_ends(t, vertex[0], from[0], from[1]);
    for (int j = 0; j < 3; j++) {
        tm_touch_ends(t, vertex[1 + j], e[j], d[j]);
        vsub(e[j], from[0], e[j]);
        vsub(d[j], from[1], d[j]);
        vsub(d[j], e[j], d[j]);
    }
    cubic[0] = determinant(e[0], e[1], e[2]);
    cubic[1] = determinant(d[0], e[1], e[2]) + determinant(e[0], d[1], e[2]) + determinant(e[0], e[1], d[2]);
    cubic[2] = determinant(d[0], d[1], e[2]) + determinant(d[0], e[1], d[2]) + determinant(e[0], d[1], d[2]);
    cubic[3] = determinant(d[0], d[1], d[2]);
}

double tm_touch_volume_at(const double c[4], double x) { return ((c[3] * x + c[2]) * x + c[1]) * x + c[0]; }

int tm_touch_volume_parts(const double c[4], double end[4]) {
    const double a = 3 * c[3], half = c[2], root2 = half * half - a * c[1];
    int count = 0;
    end[0] = 0;
    if (root2 > 0) {
        const double q = -(half + copysign(sqrt(root2), half)), one = a != 0 ? q / a : -1, two = q != 0 ? c[1] / q : -1;
        const double low = law_min(one, two), high = law_max(one, two);
        if (low > 0 && low < 1) end[++count] = low;
        if (high > 0 && high < 1) end[++count] = high;
    }
    end[++count] = 1;
    return count;
}

bool tm_touch_volume_crosses(const double c[4]) {
    double end[4];
    const int parts = tm_touch_volume_parts(c, end);
    bool crosses = false;
    for (int i = 0; i < parts; i++)
        crosses |= (tm_touch_volume_at(c, end[i]) > 0) != (tm_touch_volume_at(c, end[i + 1]) > 0);
    return crosses;
}

double tm_touch_volume_root(const double c[4], double low, double high) {
    const bool from_positive = tm_touch_volume_at(c, low) > 0;
    for (int i = 0; i < 50; i++) {
        const double middle = 0.5 * (low + high);
        *((tm_touch_volume_at(c, middle) > 0) == from_positive ? &low : &high) = middle;
    }
    return 0.5 * (low + high);
}
