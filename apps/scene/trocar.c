/* Chooses the first instrument's trocar and its target. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "organ.h"
#include "scene/surface_distance.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

static const double radius_m = 2.5e-3, shaft_m = 0.12, tilt_rad = 0.5;

/* Finds the middle of the tumour, else of the box. Returns whether there is a tumour. */
static bool find_aim(organ *o, double aim[3]) {
    double weight = 0;
    memset(aim, 0, 3 * sizeof *aim);
    for (int32_t t = 0; t < o->mesh->tet_count; t++) {
        const double v = o->mesh->volume_m3[t];
        if (o->tissue[o->mesh->region[t]]->role != TISSUE_TUMOUR) continue;
        if (!o->aim) o->aim = o->file.region_name[o->mesh->region[t]];
        weight += v;
        for (int k = 0; k < 12; k++) aim[k % 3] += 0.25 * v * o->mesh->rest_m[3 * o->mesh->tet[4 * t + k / 3] + k % 3];
    }
    for (int a = 0; a < 3; a++) aim[a] = weight > 0 ? aim[a] / weight : 0.5 * (o->low_m[a] + o->high_m[a]);
    return weight > 0;
}

/* Finds the first surface point on a ray from far along `towards`, backwards. Returns false if there is none. */
/* `out` may be `through`. */
static bool first_point(const organ *o, const double towards[3], const double through[3], double out[3]) {
    double from[3], back[3];
    for (int a = 0; a < 3; a++) {
        from[a] = through[a] + 2 * o->size_m * towards[a];
        back[a] = -towards[a];
    }
    const double way = sim_way_to_touch(o->mesh, from, back, radius_m);
    for (int a = 0; a < 3; a++) out[a] = from[a] + way * back[a];
    return way >= 0;
}

/* Returns the distance to the nearest fixed vertex. */
static double held_away_m(const organ *o, const uint8_t *held, const double point[3]) {
    double least = INFINITY;
    for (int32_t v = 0; v < o->mesh->vertex_count; v++) {
        double d[3];
        vsub(o->mesh->rest_m + 3 * v, point, d);
        if (held[v]) least = fmin(least, vdot(d, d));
    }
    return sqrt(least);
}

/* Finds a point of the upper surface above the aim, or near it, preferring higher points. */
static void find_target(organ *o, const uint8_t *held) {
    enum { COLUMNS = 9 };
    const int u = o->up_axis, p = (u + 1) % 3, q = (u + 2) % 3;
    double aim[3], best = INFINITY;
    const bool tumour = find_aim(o, aim);
    for (int i = 0; i < COLUMNS * COLUMNS; i++) {
        double through[3], point[3], away[3], bottom[3];
        const double down[3] = {-o->up[0], -o->up[1], -o->up[2]};
        memcpy(through, aim, sizeof aim);
        const double near = tumour ? 0.25 : 0.8; /* share of the box that is searched */
        through[p] += near * (o->high_m[p] - o->low_m[p]) * (i % COLUMNS - COLUMNS / 2) / COLUMNS;
        through[q] += near * (o->high_m[q] - o->low_m[q]) * (i / COLUMNS - COLUMNS / 2) / COLUMNS;
        if (!first_point(o, o->up, through, point) || !first_point(o, down, through, bottom)) continue;
        vsub(point, aim, away);
        const double height = vdot(away, o->up), aside = sqrt(fmax(vdot(away, away) - height * height, 0));
        const double score = aside - 0.6 * height + 3 * fmax(0.15 * o->size_m - held_away_m(o, held, point), 0);
        if (score >= best) continue;
        best = score;
        memcpy(o->target_m, point, sizeof point);
        const double thickness_m = fabs(point[u] - bottom[u]);
        o->depth_m = fmin(fmin(fmax(0.04 * o->size_m, 2e-3), 10e-3), 0.25 * thickness_m);
    }
    if (isfinite(best)) return;
    memcpy(o->target_m, aim, sizeof aim); /* no surface below the grid: the middle, from above */
    o->depth_m = 2e-3;
}

/* Chooses the side from which an instrument points at `target`: free of obstacles and, if `other` is given, away from
 * that trocar. */
static void find_side(const organ *o, const double target[3], const double *other, double trocar[3], double axis[3],
                      double tool_up[3]) {
    enum { AROUND = 8 };
    const int p = (o->up_axis + 1) % 3, q = (o->up_axis + 2) % 3;
    double best = INFINITY;
    for (int i = 0; i <= AROUND; i++) {
        const double angle = 2 * M_PI * i / AROUND, lean = i < AROUND ? tilt_rad : 0;
        double towards[3], from[3], back[3], apart[3] = {1, 0, 0};
        for (int a = 0; a < 3; a++) towards[a] = cos(lean) * o->up[a];
        towards[p] += sin(lean) * cos(angle);
        towards[q] += sin(lean) * sin(angle);
        for (int a = 0; a < 3; a++) {
            from[a] = target[a] + shaft_m * towards[a];
            back[a] = -towards[a];
        }
        if (other) vsub(from, other, apart);
        const double way = sim_way_to_touch(o->mesh, from, back, radius_m);
        const double miss =
            (way < 0 || sim_is_inside(o->mesh, from) ? 1 : fabs(way - shaft_m) + (i == AROUND ? 5e-3 : 0)) +
            0.5 * fmax(0.5 * shaft_m - sqrt(vdot(apart, apart)), 0);
        if (miss >= best) continue;
        best = miss;
        memcpy(trocar, from, sizeof from);
        memcpy(axis, back, sizeof back);
    }
    memset(tool_up, 0, 3 * sizeof *tool_up);
    tool_up[fabs(axis[q]) < fabs(axis[p]) ? q : p] = 1;
}

bool organ_find_trocar(organ *o) {
    uint8_t *held = calloc((size_t)o->mesh->vertex_count, 1);
    if (!held) return false;
    organ_mark_held(o, held);
    find_target(o, held);
    free(held);
    find_side(o, o->target_m, NULL, o->trocar_m, o->axis, o->tool_up);
    return true;
}

/* Finds a line on the upper surface that leads away from the first instrument's target, preferring high points away
 * from supports. */
static void find_line(organ *o, const uint8_t *held) {
    enum { AROUND = 16 };
    const int p = (o->up_axis + 1) % 3, q = (o->up_axis + 2) % 3;
    double best = -INFINITY;
    for (int i = 0; i < AROUND; i++) {
        const double angle = 2 * M_PI * i / AROUND, begin = 0.12 * o->size_m, end = 0.24 * o->size_m;
        double from[3], to[3], mean[3];
        memcpy(from, o->target_m, sizeof from);
        memcpy(to, o->target_m, sizeof to);
        from[p] += begin * cos(angle), from[q] += begin * sin(angle);
        to[p] += end * cos(angle), to[q] += end * sin(angle);
        if (!first_point(o, o->up, from, from) || !first_point(o, o->up, to, to)) continue;
        for (int a = 0; a < 3; a++) mean[a] = 0.5 * (from[a] + to[a]);
        const double free_m = fmin(held_away_m(o, held, from), held_away_m(o, held, to));
        const double score = 0.6 * vdot(mean, o->up) - fabs(vdot(from, o->up) - vdot(to, o->up)) +
                             3 * fmin(free_m - 0.15 * o->size_m, 0);
        if (score <= best) continue;
        best = score;
        o->cut = true;
        memcpy(o->cut_from_m, from, sizeof from);
        memcpy(o->cut_to_m, to, sizeof to);
    }
    o->cut_depth_m = fmin(1.5 * o->depth_m, 10e-3);
}

bool organ_find_cut(organ *o) {
    uint8_t *held = calloc((size_t)o->mesh->vertex_count, 1);
    if (!held) return false;
    organ_mark_held(o, held);
    find_line(o, held);
    free(held);
    if (o->cut) find_side(o, o->cut_from_m, o->trocar_m, o->cut_trocar_m, o->cut_axis, o->cut_up);
    return true;
}
