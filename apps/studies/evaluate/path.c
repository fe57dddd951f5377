/* Tool paths like a surgeon's: minimum-jerk strokes between way points, with tremor. */
#include <math.h>
#include <string.h>

#include "bandwidth.h"
#include "evaluate.h"

const char *const path_name[PATH_COUNT] = {"tour",           "reversals",          "other-hand-cuts",
                                           "same-hand-cuts", "grasped-and-pulled", "two-cauteries"};

/* Fields, in millimetres from the touching point: x, y along the surface; z into the tissue (negative: in the air); the
 * grip there; whether the pedal is down from there on. A stroke of zero length is a pause. */
enum { FIELDS = PATH_FIELDS, GRIP = 3, PEDAL = 4 };
static const double tour[][FIELDS] = {{0, 0, -3},  {0, 0, 3},   {6, 0, 3},   {6, 0, 3},  {2, 3, 3},
                                      {-4, 3, 5},  {-4, 3, 5},  {-4, -3, 4}, {3, -4, 4}, {3, -4, 2},
                                      {3, -4, -2}, {1, -1, -2}, {1, -1, 4},  {-3, 2, 2}, {0, 0, -3}};
static const double to_and_fro[][FIELDS] = {{0, 0, -3}, {0, 0, 3}, {0, 0, 1},   {0, 0, 4}, {0, 0, 2}, {3, 0, 3},
                                            {-3, 0, 3}, {2, 2, 3}, {-2, -2, 4}, {0, 0, 1}, {0, 0, 4}, {0, 0, -3}};
static const double cautery[][FIELDS] = {{0, 0, -3}, {0, 0, 3},        {0, 0, 3, 0, 1}, {6, 0, 3},
                                         {6, 0, 6},  {6, 0, 6, 0, 1},  {0, 2, 6},       {0, 2, 6},
                                         {-4, 2, 5}, {-4, 2, 5, 0, 1}, {-4, -3, 5},     {-4, -3, -3}};
static const double grasper[][FIELDS] = {{0, 0, -3},    {0, 0, 3},     {0, 0, 3, 1}, {0, 0, -3, 1}, {5, 0, -3, 1},
                                         {5, 0, -3, 1}, {2, 3, -2, 1}, {0, 0, 1, 1}, {0, 0, 1},     {0, 0, -5}};
/* The other hand's slit: to the tool's right, along and back deeper. */
static const double slit[][FIELDS] = {
    {10, -12, -4}, {10, -12, 4, 0, 1}, {10, 12, 4, 0, 1}, {10, -10, 7}, {10, -10, -4}};
static const double PAUSE_S = 0.4, DEEPEST_MM = 5, PEDAL_S = 0.05;

typedef struct stroke {
    const double (*point)[FIELDS];
    int count;
} stroke;

#define STROKE(table)                                                                                                  \
    { table, sizeof table / sizeof *table }
static stroke strokes(const path *p, int hand) {
    static const stroke first[PATH_COUNT] = {STROKE(tour), STROKE(to_and_fro), STROKE(tour), STROKE(cautery),
                                             STROKE(grasper)},
                        other = STROKE(slit);
    if (p->kind == PATH_RANDOM) return (stroke){p->random[hand], p->random_points};
    return hand ? other : first[p->kind];
}

static double leg_s(const path *p, const double *a, const double *b) {
    double d = sqrt((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]) + (b[2] - a[2]) * (b[2] - a[2])) *
               p->depth_m / DEEPEST_MM;
    return d > 0 ? d / p->speed_m_s : PAUSE_S;
}

double path_length_s(const path *p) {
    stroke s = strokes(p, 0);
    double sum = 0;
    for (int i = 0; i + 1 < s.count; i++) sum += leg_s(p, s.point[i], s.point[i + 1]);
    return sum;
}

path path_make(path_kind kind, double speed_m_s, double tremor_m) {
    return (path){.kind = kind, .speed_m_s = speed_m_s, .depth_m = 0.005, .tremor_m = tremor_m};
}

static double between(uint64_t *seed, double least, double most) { return least + (most - least) * app_uniform(seed); }

/* Makes a random path. A quarter of the points is in the air, as are the first and the last; from three eighths of them
 * the pedal is down. Hands stay 12 mm apart and reach 8 mm across. */
static void make_random(path *p, int hand, uint64_t *seed) {
    const double middle_mm = hand ? 6 : -6;
    for (int i = 0; i < p->random_points; i++) {
        double *to = p->random[hand][i];
        const bool end = i == 0 || i == p->random_points - 1, air = app_uniform(seed) < 0.25 || end;
        to[0] = middle_mm + between(seed, -14, 14);
        to[1] = between(seed, -10, 10);
        to[2] = air ? -3 : between(seed, 1, 5);
        to[GRIP] = 0;
        to[PEDAL] = !end && app_uniform(seed) < 0.375;
        if (i > 0 && app_uniform(seed) < 0.2) memcpy(to, to - FIELDS, 3 * sizeof *to); /* a pause */
    }
}

path path_make_random(uint64_t seed, int points, double speed_m_s, double tremor_m) {
    path p = path_make(PATH_RANDOM, speed_m_s, tremor_m);
    uint64_t state = 2 * seed + 1;
    p.random_points = points;
    for (int i = 0; i < 8; i++) app_uniform(&state); /* successive seeds begin with similar values */
    for (int hand = 0; hand < PATH_HANDS; hand++) make_random(&p, hand, &state);
    return p;
}

/* Finds the leg at a time and the completed share of it. */
static const double *leg_at(const path *p, stroke s, double time_s, double *ease) {
    int i = 0;
    double at = 0, leg = leg_s(p, s.point[0], s.point[1]);
    while (i + 2 < s.count && time_s >= at + leg) {
        at += leg;
        i++;
        leg = leg_s(p, s.point[i], s.point[i + 1]);
    }
    double t = fmin(fmax((time_s - at) / leg, 0), 1);
    *ease = t * t * t * (10 + t * (6 * t - 15));
    return s.point[i];
}

static bool pedal(const path *p, int hand, double time_s) {
    double unused, frame_end_s = PEDAL_S * ceil(time_s / PEDAL_S - 1e-6);
    return leg_at(p, strokes(p, hand), frame_end_s - 0.5 * PEDAL_S, &unused)[PEDAL] > 0;
}

tm_tool_pose path_pose(const path *p, int hand, double time_s) {
    tm_tool_pose pose = {.active = true};
    double ease, m[3], scale = p->depth_m / DEEPEST_MM, w = 2 * M_PI * 9 * time_s;
    const double *a = leg_at(p, strokes(p, hand), time_s, &ease), *b = a + FIELDS;
    for (int i = 0; i < 3; i++) m[i] = scale * (a[i] + ease * (b[i] - a[i]));
    const double tremor = hand ? 0 : 0.5 * p->tremor_m;
    pose.tip_m[0] = p->entry_m[0] + m[0] + tremor * (sin(0.83 * w) + sin(1.17 * w + 1));
    pose.tip_m[1] = p->entry_m[1] + m[1] + tremor * (sin(0.91 * w + 2) + sin(1.09 * w + 3));
    pose.tip_m[2] = p->entry_m[2] - m[2] + tremor * (sin(0.87 * w + 4) + sin(1.13 * w + 5));
    pose.grip = a[GRIP] + ease * (b[GRIP] - a[GRIP]);
    if (hand || p->kind == PATH_SAME_HAND_CUTS || p->kind == PATH_RANDOM) pose.active = pedal(p, hand, time_s);
    return pose;
}
