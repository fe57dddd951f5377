/* Jaw of a grasper: its frame, and the vertices between the jaws. Geometry only: the grasp stage and the precomputed
 * model use it. */
#include "tensormass/grasp.h"

#include <math.h>

#include "base/contract.h"
#include "base/vec.h"
#include "libtensormass/numeric/elementary.h"

void tm_jaw_begin(tm_jaw *jaw, const tm_instrument_def *tool, const tm_tool_pose *pose) {
    TM_REQUIRE(jaw && tool && pose, "jaw, tool or pose is null", );
    tm_tool_direction(tool, pose, jaw->origin);
}

/* Computes the frame: the shaft's direction e, and two axes across it by the shortest rotation from `origin` to e,
 * rolled about e. */
void tm_jaw_rotate(tm_jaw *h, const tm_instrument_def *tool, const tm_tool_pose *pose) {
    TM_REQUIRE(h && tool && pose, "jaw, tool or pose is null", );
    double e[3], side[3], across[3], *x = h->axis_m[0], *y = h->axis_m[1];
    if (tool->is_free)
        tm_tool_direction(tool, pose, e);
    else
        vsub(pose->tip_m, tool->trocar_m, e);
    if (vunit(e, e) <= 0) vset(h->origin, e);
    /* a fixed vector across origin, rotated along */
    double least[3] = {0, 0, 0};
    int axis = 0;
    for (int c = 1; c < 3; c++)
        if (fabs(h->origin[c]) < fabs(h->origin[axis])) axis = c;
    least[axis] = 1;
    vcross(h->origin, least, side);
    vunit(side, side);
    vcross(h->origin, e, across);
    double cosine = vdot(h->origin, e), s = vdot(across, side) / fmax(1 + cosine, 1e-6);
    vcross(across, side, x);
    for (int c = 0; c < 3; c++) x[c] += cosine * side[c] + s * across[c];
    vmadd(x, -vdot(x, e), e, x);
    vunit(x, x);
    vcross(e, x, y);
    double cr, sr, rolled[3];
    tm_sine_cosine(pose->roll_rad, &sr, &cr);
    for (int c = 0; c < 3; c++) {
        rolled[c] = cr * x[c] + sr * y[c];
        y[c] = cr * y[c] - sr * x[c];
    }
    vset(rolled, x);
    vset(e, h->axis_m[2]);
}

void tm_jaw_to_tool(const tm_jaw *h, const tm_tool_pose *pose, const double at_m[3], double offset_m[3]) {
    TM_REQUIRE(h && pose && at_m && offset_m, "jaw, pose, at_m or offset_m is null", );
    double d[3];
    vsub(at_m, pose->tip_m, d);
    for (int c = 0; c < 3; c++) offset_m[c] = vdot(d, h->axis_m[c]);
}

void tm_jaw_to_world(const tm_jaw *h, const tm_tool_pose *pose, const double offset_m[3], double at_m[3]) {
    TM_REQUIRE(h && pose && offset_m && at_m, "jaw, pose, offset_m or at_m is null", );
    vset(pose->tip_m, at_m);
    for (int c = 0; c < 3; c++) vmadd(at_m, offset_m[c], h->axis_m[c], at_m);
}

/* Returns the squared distance of point q from triangle p, by Voronoi regions. */
static double point_triangle(const double q[3], const double p[3][3]) {
    double ab[3], ac[3], aq[3], n[3], d[3], best = INFINITY;
    vsub(p[1], p[0], ab);
    vsub(p[2], p[0], ac);
    vsub(q, p[0], aq);
    vcross(ab, ac, n);
    double nn = vdot(n, n), cross[3];
    vcross(aq, ac, cross);
    double s = nn > 0 ? vdot(cross, n) / nn : -1;
    vcross(ab, aq, cross);
    double t = nn > 0 ? vdot(cross, n) / nn : -1;
    if (s >= 0 && t >= 0 && s + t <= 1) return vdot(aq, n) * vdot(aq, n) / nn;
    for (int j = 0; j < 3; j++) {
        vsub(p[(j + 1) % 3], p[j], ab);
        vsub(q, p[j], aq);
        double length2 = vdot(ab, ab);
        vmadd(aq, -(length2 > 0 ? law_clamp(vdot(aq, ab) / length2, 0, 1) : 0), ab, d);
        best = fmin(best, vdot(d, d));
    }
    return best;
}

/* Returns the distance of the jaw's axis from a triangle, sampled at eighths of the jaw: enough for capture. */
static double jaw_distance(const tm_capsule *jaw, const double p[3][3]) {
    double best = INFINITY;
    for (int k = 0; k <= 8; k++) {
        double q[3];
        for (int c = 0; c < 3; c++) q[c] = jaw->tip_m[c] + k / 8.0 * (jaw->tail_m[c] - jaw->tip_m[c]);
        best = fmin(best, point_triangle(q, p));
    }
    return sqrt(best);
}

/* Captured vertices: each once, with the distance of its nearest triangle; beyond the capacity the farthest is
 * dropped. */
typedef struct catch {
    int32_t count, max, *vertex;
    double *distance_m;
}
catch;

/* Adds a captured vertex, or shortens its distance; drops the farthest if there are too many. */
static void take_vertex(catch *h, int32_t vertex, double distance_m) {
    int32_t farthest = 0;
    for (int32_t i = 0; i < h->count; i++) {
        if (h->vertex[i] == vertex) {
            h->distance_m[i] = fmin(h->distance_m[i], distance_m);
            return;
        }
        if (h->distance_m[i] > h->distance_m[farthest]) farthest = i;
    }
    int32_t at = h->count;
    if (h->count == h->max) {
        if (h->distance_m[farthest] <= distance_m) return;
        at = farthest;
    } else {
        h->count++;
    }
    h->vertex[at] = vertex;
    h->distance_m[at] = distance_m;
}

int32_t tm_jaw_capture(const tm_jaw *jaw, const tm_grasp_def *def, const tm_instrument_def *tool,
                       const tm_tool_pose *pose, const double *rest_m, const double *u_m,
                       const tm_surface_view *surface, int32_t *vertex, double *distance_m) {
    TM_REQUIRE(jaw && def && tool && pose && rest_m && u_m && surface,
               "jaw, def, tool, pose, rest_m, u_m or surface is null", 0);
    TM_REQUIRE(def->max_vertices >= 0 && (def->max_vertices == 0 || (vertex && distance_m)),
               "def->max_vertices is negative, or vertex or distance_m is null", 0);
    catch h = {.max = def->max_vertices, .vertex = vertex, .distance_m = distance_m};
    tm_capsule axis;
    vset(pose->tip_m, axis.tip_m);
    vmadd(axis.tip_m, -def->jaw_length_m, jaw->axis_m[2], axis.tail_m);
    for (int32_t i = 0; i < surface->count; i++) {
        double p[3][3], distance;
        for (int j = 0; j < 9; j++) {
            int32_t dof = 3 * surface->triangle[3 * i + j / 3] + j % 3;
            p[j / 3][j % 3] = rest_m[dof] + u_m[dof];
        }
        distance = jaw_distance(&axis, p);
        for (int j = 0; j < 3 && distance <= tool->radius_m + def->reach_m; j++)
            take_vertex(&h, surface->triangle[3 * i + j], distance);
    }
    for (int32_t i = 1; i < h.count; i++) { /* by number: independent of the order of the surface */
        int32_t moving = h.vertex[i], j = i;
        for (; j > 0 && h.vertex[j - 1] > moving; j--) h.vertex[j] = h.vertex[j - 1];
        h.vertex[j] = moving;
    }
    return h.count;
}
