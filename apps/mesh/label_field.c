/* Builds a field of an image's labels: crops it, merges specks, finds the pieces. */
#include "label_field.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t count_of(const label_field *f) { return (size_t)f->size[0] * (size_t)f->size[1] * (size_t)f->size[2]; }

/* --- the labels and their range --- */

/* Numbers the labels; number[value] is the label in the field. */
static bool number_labels(const image_volume *image, const int *wanted, int count, uint8_t *number, label_field *f) {
    const size_t voxels = (size_t)image->size[0] * (size_t)image->size[1] * (size_t)image->size[2];
    uint8_t *there = calloc(65536, 1);
    if (!there) return false;
    for (size_t i = 0; i < voxels; i++) there[image->label[i]] = 1;
    if (wanted)
        for (int w = 0; w < count; w++) f->value[++f->labels] = wanted[w];
    else
        for (int v = 1; v < 65536 && f->labels < LABEL_MAX; v++)
            if (there[v]) f->value[++f->labels] = v;
    for (int l = 1; l <= f->labels; l++) number[f->value[l]] = (uint8_t)l;
    free(there);
    return true;
}

static void find_box(const image_volume *image, const uint8_t *number, int low[3], int high[3]) {
    for (int k = 0; k < 3; k++) low[k] = image->size[k], high[k] = -1;
    const uint16_t *at = image->label;
    for (int z = 0; z < image->size[2]; z++)
        for (int y = 0; y < image->size[1]; y++)
            for (int x = 0; x < image->size[0]; x++)
                if (number[*at++]) {
                    const int place[3] = {x, y, z};
                    for (int k = 0; k < 3; k++) {
                        if (place[k] < low[k]) low[k] = place[k];
                        if (place[k] > high[k]) high[k] = place[k];
                    }
                }
}

static bool crop(const image_volume *image, const uint8_t *number, int margin, label_field *f) {
    int low[3], high[3];
    find_box(image, number, low, high);
    for (int k = 0; k < 3; k++) {
        if (high[k] < 0)
            low[k] = high[k] = 0;
        else
            f->at_border = f->at_border || low[k] == 0 || high[k] == image->size[k] - 1;
        f->begin[k] = low[k] - margin;
        f->size[k] = high[k] - low[k] + 1 + 2 * margin;
        f->spacing_m[k] = image->spacing_m[k];
    }
    f->at = calloc(count_of(f), 1);
    for (int z = low[2]; f->at && z <= high[2]; z++)
        for (int y = low[1]; y <= high[1]; y++) {
            const uint16_t *from =
                image->label + ((size_t)z * (size_t)image->size[1] + (size_t)y) * (size_t)image->size[0];
            uint8_t *to =
                f->at +
                ((size_t)(z - f->begin[2]) * (size_t)f->size[1] + (size_t)(y - f->begin[1])) * (size_t)f->size[0] -
                f->begin[0];
            for (int x = low[0]; x <= high[0]; x++) to[x] = number[from[x]];
        }
    return f->at != NULL;
}

/* --- pieces --- */

typedef struct flood {
    int32_t *piece; /* [voxels] piece of each voxel, -1: none yet */
    int64_t *stack;
    label_piece *found;
    int64_t *first; /* first voxel of each piece */
    int count, capacity;
} flood;

static void place_of(const label_field *f, int64_t i, int place[3]) {
    place[0] = (int)(i % f->size[0]);
    place[1] = (int)(i / f->size[0] % f->size[1]);
    place[2] = (int)(i / f->size[0] / f->size[1]);
}

/* Lists the voxels around `i`: 6 neighbours, or 26. */
static int around(const label_field *f, int64_t i, bool corners, int64_t out[26]) {
    int p[3], count = 0;
    place_of(f, i, p);
    for (int z = -1; z <= 1; z++)
        for (int y = -1; y <= 1; y++)
            for (int x = -1; x <= 1; x++) {
                const int steps = abs(x) + abs(y) + abs(z);
                if (steps == 0 || (!corners && steps > 1)) continue;
                if (p[0] + x < 0 || p[1] + y < 0 || p[2] + z < 0 || p[0] + x >= f->size[0] || p[1] + y >= f->size[1] ||
                    p[2] + z >= f->size[2])
                    continue;
                out[count++] = i + x + (int64_t)f->size[0] * (y + (int64_t)f->size[1] * z);
            }
    return count;
}

/* Fills the piece that contains voxel `from`. Labels connect through corners too, the outside only through faces. */
static void fill(const label_field *f, flood *w, int64_t from) {
    int64_t next[26], top = 0;
    w->piece[from] = w->count;
    w->stack[top++] = from;
    label_piece *piece = &w->found[w->count];
    *piece = (label_piece){.label = f->at[from]};
    w->first[w->count] = from;
    while (top > 0) {
        const int64_t i = w->stack[--top];
        piece->voxels++;
        const int count = around(f, i, piece->label != 0, next);
        for (int n = 0; n < count; n++)
            if (w->piece[next[n]] < 0 && f->at[next[n]] == piece->label) {
                w->piece[next[n]] = w->count;
                w->stack[top++] = next[n];
            }
    }
    w->count++;
}

static void flood_free(flood *w) {
    free(w->piece);
    free(w->stack);
    free(w->found);
    free(w->first);
}

/* Finds the piece of every voxel. */
static bool find_pieces(const label_field *f, flood *w) {
    const size_t voxels = count_of(f);
    *w = (flood){.piece = malloc(voxels * sizeof *w->piece), .stack = malloc(voxels * sizeof *w->stack)};
    if (!w->piece || !w->stack) return false;
    memset(w->piece, 0xff, voxels * sizeof *w->piece);
    for (size_t i = 0; i < voxels; i++) {
        if (w->piece[i] >= 0) continue;
        if (w->count == w->capacity) {
            w->capacity = w->capacity ? 2 * w->capacity : 256;
            label_piece *found = realloc(w->found, (size_t)w->capacity * sizeof *found);
            if (found) w->found = found;
            int64_t *first = realloc(w->first, (size_t)w->capacity * sizeof *first);
            if (first) w->first = first;
            if (!found || !first) return false;
        }
        fill(f, w, (int64_t)i);
    }
    return true;
}

/* Returns the label that a piece touches most, over faces. */
static int label_around(const label_field *f, const flood *w, int piece, int64_t *members, int64_t *count) {
    int64_t touched[LABEL_MAX + 1] = {0}, next[26], seen = 0;
    members[seen++] = w->first[piece];
    /* visits the piece's voxels again, with a mark that no piece uses */
    w->piece[members[0]] = -2;
    for (int64_t m = 0; m < seen; m++) {
        const int neighbours = around(f, members[m], w->found[piece].label != 0, next);
        for (int n = 0; n < neighbours; n++)
            if (w->piece[next[n]] == piece) {
                w->piece[next[n]] = -2;
                members[seen++] = next[n];
            }
        const int faces = around(f, members[m], false, next);
        for (int n = 0; n < faces; n++)
            touched[f->at[next[n]]] += w->piece[next[n]] != -2 && f->at[next[n]] != w->found[piece].label;
    }
    int most = 0;
    for (int l = 1; l <= f->labels; l++)
        if (touched[l] > touched[most]) most = l;
    *count = seen;
    return most;
}

static void join_specks(label_field *f, flood *w, int64_t specks) {
    int largest[LABEL_MAX + 1];
    memset(largest, 0xff, sizeof largest);
    for (int p = 0; p < w->count; p++) {
        int *l = &largest[w->found[p].label];
        if (*l < 0 || w->found[p].voxels > w->found[*l].voxels) *l = p;
    }
    for (int p = 0; p < w->count; p++) {
        if (w->found[p].voxels >= specks || p == largest[w->found[p].label]) continue;
        int64_t count;
        const int label = label_around(f, w, p, w->stack, &count);
        for (int64_t m = 0; m < count; m++) f->at[w->stack[m]] = (uint8_t)label;
        f->specks++;
        f->speck_voxels += count;
    }
}

/* --- reference values of the report --- */

static void measure(label_field *f) {
    const double area[3] = {f->spacing_m[1] * f->spacing_m[2], f->spacing_m[0] * f->spacing_m[2],
                            f->spacing_m[0] * f->spacing_m[1]};
    const int64_t step[3] = {1, f->size[0], (int64_t)f->size[0] * f->size[1]};
    int low[LABEL_MAX + 1][3], high[LABEL_MAX + 1][3];
    for (int l = 0; l <= LABEL_MAX; l++)
        for (int k = 0; k < 3; k++) low[l][k] = f->size[k], high[l][k] = -1;
    for (int64_t i = 0; i < (int64_t)count_of(f); i++) {
        const int label = f->at[i];
        int p[3];
        if (!label) continue;
        place_of(f, i, p);
        f->voxels[label]++;
        for (int k = 0; k < 3; k++) { /* the margin keeps i inside */
            if (p[k] < low[label][k]) low[label][k] = p[k];
            if (p[k] > high[label][k]) high[label][k] = p[k];
            f->face_m2[label] += area[k] * ((f->at[i - step[k]] != label) + (f->at[i + step[k]] != label));
        }
    }
    for (int l = 1; l <= f->labels; l++) {
        f->thin[l] = f->voxels[l] ? 1 << 30 : 0;
        for (int k = 0; k < 3 && f->voxels[l]; k++)
            if (high[l][k] - low[l][k] + 1 < f->thin[l]) f->thin[l] = high[l][k] - low[l][k] + 1;
    }
}

/* Finds the point in each piece where its label is strongest. */
static void find_seeds(label_field *f, const flood *w) {
    for (int p = 0; p < w->count; p++)
        if (w->found[p].label) {
            f->pieces[w->found[p].label]++;
            f->piece[f->piece_count++] = w->found[p];
            w->stack[p] = f->piece_count - 1;
        }
    int *strongest = calloc((size_t)f->piece_count + 1, sizeof *strongest);
    for (int64_t i = 0; strongest && i < (int64_t)count_of(f); i++) {
        const int label = f->at[i];
        if (!label) continue;
        const int64_t piece = w->stack[w->piece[i]];
        int weight = 0, place[3];
        for (int k = 0; k < LABEL_LAYERS; k++)
            if (f->voxel[i].label[k] == label) weight = f->voxel[i].weight[k];
        if (weight < strongest[piece]) continue;
        if (weight == strongest[piece] && weight) continue;
        strongest[piece] = weight;
        place_of(f, i, place);
        for (int k = 0; k < 3; k++) f->piece[piece].seed_m[k] = (place[k] + f->begin[k]) * f->spacing_m[k];
    }
    free(strongest);
}

bool label_field_build(const image_volume *image, const int *wanted, int count, int64_t specks, double smooth,
                       bool even, label_field *f) {
    *f = (label_field){0};
    flood w = {0};
    uint8_t *number = calloc(65536, 1);
    bool good = number && number_labels(image, wanted, count, number, f) &&
                crop(image, number, (int)ceil(3 * smooth) + 2, f) && find_pieces(f, &w);
    if (good && specks > 1) {
        join_specks(f, &w, specks);
        flood_free(&w);
        good = find_pieces(f, &w);
    }
    if (good) measure(f);
    good = good && label_field_smooth(f, smooth, even) && (f->piece = malloc(((size_t)w.count + 1) * sizeof *f->piece));
    if (good) find_seeds(f, &w);
    flood_free(&w);
    free(number);
    if (!good) label_field_free(f);
    return good;
}

void label_field_free(label_field *f) {
    free(f->at);
    free(f->voxel);
    free(f->piece);
    *f = (label_field){0};
}
