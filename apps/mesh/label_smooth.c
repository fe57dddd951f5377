/* Smooths each label with a Gaussian and selects the strongest at each point. The surface between two labels is where
 * their smoothed indicators are equal, not the voxels' steps.
 *
 * Weighted labels of Stalling, Zoeckler and Hege 1998, but with the three strongest instead of one, so that values
 * between voxels are exact. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "label_field.h"

typedef struct box {
    int low[3], size[3];
} box;
typedef struct blur {
    float *kernel; /* [2*reach+1] sums to 1 */
    int reach;
} blur;
static const double SIGMA_SHARE = 0.28; /* relative to a thin label's thickness */

static size_t index_of(const label_field *f, int x, int y, int z) {
    return ((size_t)z * (size_t)f->size[1] + (size_t)y) * (size_t)f->size[0] + (size_t)x;
}

/* Finds the boxes of all labels, enlarged by `margin`, within the field. */
static void find_boxes(const label_field *f, int margin, box boxes[LABEL_MAX + 1]) {
    int high[LABEL_MAX + 1][3];
    for (int l = 0; l <= LABEL_MAX; l++)
        for (int k = 0; k < 3; k++) boxes[l].low[k] = f->size[k], high[l][k] = -1;
    const uint8_t *at = f->at;
    for (int z = 0; z < f->size[2]; z++)
        for (int y = 0; y < f->size[1]; y++)
            for (int x = 0; x < f->size[0]; x++, at++) {
                const int p[3] = {x, y, z};
                for (int k = 0; *at && k < 3; k++) {
                    if (p[k] < boxes[*at].low[k]) boxes[*at].low[k] = p[k];
                    if (p[k] > high[*at][k]) high[*at][k] = p[k];
                }
            }
    for (int l = 0; l <= LABEL_MAX; l++)
        for (int k = 0; k < 3; k++) {
            boxes[l].low[k] = boxes[l].low[k] > margin ? boxes[l].low[k] - margin : 0;
            high[l][k] = high[l][k] + margin < f->size[k] ? high[l][k] + margin : f->size[k] - 1;
            boxes[l].size[k] = high[l][k] - boxes[l].low[k] + 1;
        }
}

/* Applies one axis of the Gaussian to a box: lines of `length` values, `step` apart. */
static void blur_lines(float *value, const box *b, int axis, const float *kernel, int reach, float *line) {
    const size_t step = axis == 0 ? 1 : axis == 1 ? (size_t)b->size[0] : (size_t)b->size[0] * (size_t)b->size[1];
    const int length = b->size[axis], u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
    const size_t step_u = u == 0 ? 1 : (size_t)b->size[0],
                 step_v = v == 1 ? (size_t)b->size[0] : (size_t)b->size[0] * (size_t)b->size[1];
    memset(line, 0, ((size_t)length + 2 * (size_t)reach) * sizeof *line);
    for (int j = 0; j < b->size[v]; j++)
        for (int i = 0; i < b->size[u]; i++) {
            float *at = value + (size_t)i * step_u + (size_t)j * step_v, any = 0;
            for (int n = 0; n < length; n++) any += line[reach + n] = at[(size_t)n * step];
            if (!(any > 0)) continue;
            for (int n = 0; n < length; n++) {
                float sum = 0;
                for (int k = 0; k <= 2 * reach; k++) sum += kernel[k] * line[n + k];
                at[(size_t)n * step] = sum;
            }
        }
}

/* Inserts a label into the voxel's list, strongest first. */
static void enter(label_voxel *v, int label, float strength) {
    const uint16_t weight = (uint16_t)(strength >= 1 ? 65535 : strength * 65535);
    int at = LABEL_LAYERS;
    while (at > 0 && weight > v->weight[at - 1]) at--;
    for (int k = LABEL_LAYERS - 1; k > at; k--) v->weight[k] = v->weight[k - 1], v->label[k] = v->label[k - 1];
    if (at < LABEL_LAYERS) v->weight[at] = weight, v->label[at] = (uint8_t)label;
}

/* Computes a label's smoothed indicator over its box, into value[]. */
static void blur_label(const label_field *f, int label, const box *b, const blur *with, float *value, float *line) {
    float *to = value;
    for (int z = 0; z < b->size[2]; z++)
        for (int y = 0; y < b->size[1]; y++)
            for (int x = 0; x < b->size[0]; x++)
                *to++ = f->at[index_of(f, b->low[0] + x, b->low[1] + y, b->low[2] + z)] == label;
    for (int axis = 0; axis < 3 && with->reach; axis++) blur_lines(value, b, axis, with->kernel, with->reach, line);
}

/* Adds value[] times `share` (null: 1) to total[], and to the voxels' lists if requested. */
static void spread(label_field *f, int label, const box *b, const float *value, const float *share, bool listed,
                   float *total) {
    for (int z = 0; z < b->size[2]; z++)
        for (int y = 0; y < b->size[1]; y++)
            for (int x = 0; x < b->size[0]; x++, value++) {
                if (!(*value > 0)) continue;
                const size_t i = index_of(f, b->low[0] + x, b->low[1] + y, b->low[2] + z);
                const float strength = share ? *value * share[i] : *value;
                if (listed) enter(&f->voxel[i], label, strength);
                total[i] += strength;
            }
}

static void fill_kernel(blur *with, double sigma) {
    float sum = 0;
    for (int k = 0; k <= 2 * with->reach; k++)
        sum += with->kernel[k] =
            with->reach ? (float)exp(-0.5 * (k - with->reach) * (k - with->reach) / (sigma * sigma)) : 1;
    for (int k = 0; k <= 2 * with->reach; k++) with->kernel[k] /= sum;
}

/* Returns the Gaussian's standard deviation, smaller for a thin label: a share of its thickness 2 volume / area. Voxel
 * faces have about 1.5 times the area of the surface. */
static float sigma_of(const label_field *f, int label, double smooth) {
    const double voxel_m3 = f->spacing_m[0] * f->spacing_m[1] * f->spacing_m[2];
    const double thick = 3 * (double)f->voxels[label] * voxel_m3 / f->face_m2[label] / cbrt(voxel_m3);
    return (float)fmin(smooth, SIGMA_SHARE * thick);
}

/* Smooths thin labels first. The others share the remainder in the ratio in which they would share it if thin labels
 * were as smooth as they. Two labels then meet at one half each, for any Gaussians. */
static void smooth_all(label_field *f, double smooth, blur *with, float *const room[4], float *line) {
    static box boxes[LABEL_MAX + 1];
    float *value = room[0], *total = room[1], *wide = room[2], *share = room[3];
    const size_t voxels = (size_t)f->size[0] * (size_t)f->size[1] * (size_t)f->size[2];
    find_boxes(f, with->reach, boxes);
    for (int l = 1; l <= f->labels; l++) {
        if (!f->voxels[l] || (double)f->sigma[l] >= smooth) continue;
        fill_kernel(with, smooth);
        blur_label(f, l, &boxes[l], with, value, line);
        spread(f, l, &boxes[l], value, NULL, false, wide);
        fill_kernel(with, (double)f->sigma[l]);
        blur_label(f, l, &boxes[l], with, value, line);
        spread(f, l, &boxes[l], value, NULL, true, total);
    }
    for (size_t i = 0; i < voxels; i++) share[i] = (1 - fminf(total[i], 1)) / fmaxf(1 - wide[i], 1e-3f);
    fill_kernel(with, smooth);
    for (int l = 1; l <= f->labels; l++) {
        if (!f->voxels[l] || (double)f->sigma[l] < smooth) continue;
        blur_label(f, l, &boxes[l], with, value, line);
        spread(f, l, &boxes[l], value, share, true, total);
    }
    for (size_t i = 0; i < voxels; i++)
        if (total[i] < 1) enter(&f->voxel[i], 0, 1 - total[i]);
}

bool label_field_smooth(label_field *f, double smooth, bool even) {
    const size_t voxels = (size_t)f->size[0] * (size_t)f->size[1] * (size_t)f->size[2];
    const int longest = f->size[0] > f->size[1] ? f->size[0] : f->size[1];
    blur with = {.reach = (int)ceil(3 * smooth)};
    float *room[4] = {0};
    float *line =
        malloc(((size_t)(longest > f->size[2] ? longest : f->size[2]) + 2 * (size_t)with.reach) * sizeof *line);
    with.kernel = calloc(2 * (size_t)with.reach + 1, sizeof *with.kernel);
    f->voxel = calloc(voxels, sizeof *f->voxel);
    bool good = with.kernel && line && f->voxel;
    for (int i = 0; i < 4; i++) good = (room[i] = calloc(voxels, sizeof *room[i])) && good;
    for (int l = 1; l <= f->labels && good; l++)
        if (f->voxels[l]) f->sigma[l] = even ? (float)smooth : sigma_of(f, l, smooth);
    if (good) smooth_all(f, smooth, &with, room, line);
    for (int i = 0; i < 4; i++) free(room[i]);
    free(with.kernel);
    free(line);
    return good;
}

/* The labels at a point and their strengths; false: only label[0]. */
typedef struct mix {
    int label[8 * LABEL_LAYERS], count;
    float strength[8 * LABEL_LAYERS];
} mix;

static bool mix_at(const label_field *f, const double p[3], mix *m) {
    int base[3];
    float part[3];
    m->count = 1;
    m->label[0] = 0;
    for (int k = 0; k < 3; k++) {
        const double x = p[k] / f->spacing_m[k] - f->begin[k];
        if (!(x >= 0) || !(x < f->size[k] - 1)) return false;
        base[k] = (int)x;
        part[k] = (float)(x - base[k]);
    }
    const label_voxel *corner[8];
    bool same = true;
    for (int c = 0; c < 8; c++) {
        corner[c] = &f->voxel[index_of(f, base[0] + (c & 1), base[1] + (c >> 1 & 1), base[2] + (c >> 2))];
        same = same && corner[c]->label[0] == corner[0]->label[0] && corner[c]->weight[0] > 65000;
    }
    m->label[0] = corner[0]->label[0];
    if (same) return false;
    m->count = 0;
    for (int c = 0; c < 8; c++) {
        const float share =
            (c & 1 ? part[0] : 1 - part[0]) * (c >> 1 & 1 ? part[1] : 1 - part[1]) * (c >> 2 ? part[2] : 1 - part[2]);
        for (int k = 0; k < LABEL_LAYERS && corner[c]->weight[k]; k++) {
            int at = 0;
            while (at < m->count && m->label[at] != corner[c]->label[k]) at++;
            if (at == m->count) m->label[m->count] = corner[c]->label[k], m->strength[m->count++] = 0;
            m->strength[at] += share * (float)corner[c]->weight[k];
        }
    }
    for (int i = 0; i < m->count; i++) m->strength[i] += 65535 * f->bias[m->label[i]];
    return true;
}

int label_field_at(const void *field, const double p[3]) {
    mix m;
    if (!mix_at(field, p, &m)) return m.label[0];
    int best = 0;
    for (int i = 1; i < m.count; i++)
        if (m.strength[i] > m.strength[best] || (m.strength[i] == m.strength[best] && m.label[i] < m.label[best]))
            best = i;
    return m.label[best];
}

/* Returns by how much `a` is stronger than `b`. */
static double lead(const label_field *f, const double p[3], int a, int b) {
    mix m;
    double sum = 0;
    if (!mix_at(f, p, &m)) return m.label[0] == a ? 65535 : m.label[0] == b ? -65535 : 0;
    for (int i = 0; i < m.count; i++) sum += m.label[i] == a ? m.strength[i] : m.label[i] == b ? -m.strength[i] : 0;
    return sum;
}

/* Computes the direction in which `a` gains on `b`; returns false if there is none. */
static bool slope_of(const label_field *f, const double p[3], int a, int b, double slope[3]) {
    double q[3] = {p[0], p[1], p[2]}, square = 0;
    for (int k = 0; k < 3; k++) {
        const double h = 0.25 * f->spacing_m[k];
        q[k] = p[k] + h;
        slope[k] = lead(f, q, a, b);
        q[k] = p[k] - h;
        slope[k] = (slope[k] - lead(f, q, a, b)) / (2 * h);
        q[k] = p[k];
        square += slope[k] * slope[k];
    }
    return square > 0;
}

bool label_field_between(const void *field, int a, int b, double p[3]) {
    const label_field *f = field;
    const double near_m = 0.02 * cbrt(f->spacing_m[0] * f->spacing_m[1] * f->spacing_m[2]);
    for (int newton = 0; newton < 8; newton++) {
        double slope[3], square = 0, moved_m2 = 0;
        if (!slope_of(f, p, a, b, slope)) return false;
        const double ahead = lead(f, p, a, b);
        for (int k = 0; k < 3; k++) square += slope[k] * slope[k];
        for (int k = 0; k < 3; k++) {
            const double step = fmax(-f->spacing_m[k], fmin(f->spacing_m[k], ahead / square * slope[k]));
            p[k] -= step;
            moved_m2 += step * step;
        }
        if (moved_m2 < near_m * near_m) return true;
    }
    return false;
}
