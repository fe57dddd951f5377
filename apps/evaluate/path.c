/* Tool paths as a surgeon's hand makes them: minimum-jerk strokes between way points, with tremor. */
#include <math.h>
#include <string.h>

#include "evaluate.h"

/* Millimetres from the touching point: along the surface x, y; into the tissue z (negative: in the air); a stroke of
 * zero length is a pause. */
static const double tour[][3] = {{0, 0, -3},  {0, 0, 3},   {6, 0, 3},   {6, 0, 3},  {2, 3, 3},
                                 {-4, 3, 5},  {-4, 3, 5},  {-4, -3, 4}, {3, -4, 4}, {3, -4, 2},
                                 {3, -4, -2}, {1, -1, -2}, {1, -1, 4},  {-3, 2, 2}, {0, 0, -3}};
static const double to_and_fro[][3] = {{0, 0, -3}, {0, 0, 3}, {0, 0, 1},   {0, 0, 4}, {0, 0, 2}, {3, 0, 3},
                                       {-3, 0, 3}, {2, 2, 3}, {-2, -2, 4}, {0, 0, 1}, {0, 0, 4}, {0, 0, -3}};
enum { TOUR = sizeof tour / sizeof *tour, TO_AND_FRO = sizeof to_and_fro / sizeof *to_and_fro };
static const double PAUSE_S = 0.4, DEEPEST_MM = 5;

typedef struct stroke {
    const double (*point)[3];
    int count;
} stroke;

static stroke strokes(const path *p) { return p->reversals ? (stroke){to_and_fro, TO_AND_FRO} : (stroke){tour, TOUR}; }

static double leg_s(const path *p, const double *a, const double *b) {
    double d = sqrt((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]) + (b[2] - a[2]) * (b[2] - a[2])) *
               p->depth_m / DEEPEST_MM;
    return d > 0 ? d / p->speed_m_s : PAUSE_S;
}

double path_length_s(const path *p) {
    stroke s = strokes(p);
    double sum = 0;
    for (int i = 0; i + 1 < s.count; i++) sum += leg_s(p, s.point[i], s.point[i + 1]);
    return sum;
}

path path_make(double speed_m_s, double tremor_m) {
    return (path){.speed_m_s = speed_m_s, .depth_m = 0.005, .tremor_m = tremor_m};
}
path path_reversals(double speed_m_s, double tremor_m) {
    return (path){.speed_m_s = speed_m_s, .depth_m = 0.005, .tremor_m = tremor_m, .reversals = true};
}

void path_tip(const path *p, double time_s, double tip_m[3]) {
    stroke s = strokes(p);
    int i = 0;
    double at = 0, leg = leg_s(p, s.point[0], s.point[1]);
    while (i + 2 < s.count && time_s >= at + leg) {
        at += leg;
        i++;
        leg = leg_s(p, s.point[i], s.point[i + 1]);
    }
    double t = fmin(fmax((time_s - at) / leg, 0), 1), ease = t * t * t * (10 + t * (6 * t - 15)), mm[3];
    for (int a = 0; a < 3; a++) mm[a] = s.point[i][a] + ease * (s.point[i + 1][a] - s.point[i][a]);
    double scale = p->depth_m / DEEPEST_MM, w = 2 * M_PI * 9 * time_s;
    tip_m[0] = p->entry_m[0] + scale * mm[0] + 0.5 * p->tremor_m * (sin(0.83 * w) + sin(1.17 * w + 1));
    tip_m[1] = p->entry_m[1] + scale * mm[1] + 0.5 * p->tremor_m * (sin(0.91 * w + 2) + sin(1.09 * w + 3));
    tip_m[2] = p->entry_m[2] - scale * mm[2] + 0.5 * p->tremor_m * (sin(0.87 * w + 4) + sin(1.13 * w + 5));
}
