/* Labels of an image as a field: which label is at a place, its surfaces smoother than the voxels' steps. */
#ifndef MESH_LABEL_FIELD_H
#define MESH_LABEL_FIELD_H

#include "image_api.h"

enum { LABEL_MAX = 255, LABEL_LAYERS = 3 };
/* Of a label's strength. Above it a thin label no longer comes to rest: volumes overshoot from pass to pass. */
#define LABEL_BIAS_MAX 0.4

/* The strongest labels at a voxel, strongest first, and how strong (65535: nothing else near). */
typedef struct label_voxel {
    uint16_t weight[LABEL_LAYERS];
    uint8_t label[LABEL_LAYERS];
} label_voxel;

/* Voxels of one label that hang together, over corners too. */
typedef struct label_piece {
    int label;
    int64_t voxels;
    double seed_m[3]; /* a place deep within */
} label_piece;

/* Places are p = (i,j,k) * spacing of the whole image. The field covers the labels and a margin. */
typedef struct label_field {
    int labels;                    /* 1 to this; 0 is nothing */
    int value[LABEL_MAX + 1];      /* of each label in the image */
    int64_t voxels[LABEL_MAX + 1]; /* after specks were joined */
    double face_m2[LABEL_MAX + 1]; /* of its voxels' outer faces */
    int thin[LABEL_MAX + 1];       /* least extent in voxels along an axis */
    int pieces[LABEL_MAX + 1];     /* that it is in */
    int64_t specks, speck_voxels;  /* pieces that joined what is around them, and what was in them */
    int size[3], begin[3];         /* of the part that is covered, in voxels of the image */
    double spacing_m[3];
    uint8_t *at;                /* [size0*size1*size2] label of each voxel */
    label_voxel *voxel;         /* the same, smoothed */
    float sigma[LABEL_MAX + 1]; /* with Gaussians of these standard deviations, voxels */
    float bias[LABEL_MAX + 1];  /* added to a label's strength: moves its surface outwards */
    label_piece *piece;         /* of all labels, in the order of their first voxel */
    int piece_count;
    bool at_border; /* a label reaches the image's end */
} label_field;

/* `wanted` are values of the image (null: all but 0). Pieces of fewer than `specks` voxels, the largest of a label
 * never among them, join what is around them most. `smooth` is the standard deviation of the Gaussian that the labels
 * are smoothed with, in voxels of each axis (0: none); less for a thin label, unless `even`. False: no memory. A wanted
 * label that is not there has voxels 0.
 */
bool label_field_build(const image_volume *image, const int *wanted, int count, int64_t specks, double smooth,
                       bool even, label_field *out);
void label_field_free(label_field *f);
/* image_label_fn; context is the field. */
int label_field_at(const void *field, const double p[3]);

/* image_between_fn; context is the field. */
bool label_field_between(const void *field, int a, int b, double p[3]);

/* Fills `voxel` from `at`. Private to label_field.c. */
bool label_field_smooth(label_field *f, double smooth, bool even);

#endif
