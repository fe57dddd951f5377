/* Labels of an image as a field: the label at any point, with smoother surfaces than the voxels. */
#ifndef MESH_LABEL_FIELD_H
#define MESH_LABEL_FIELD_H

#include "image_api.h"

enum { LABEL_MAX = 255, LABEL_LAYERS = 3 };
/* Upper bound relative to a label's strength. Above it a thin label does not converge: volumes overshoot from pass to
 * pass. */
#define LABEL_BIAS_MAX 0.4

/* The strongest labels at a voxel, in descending order, with their strengths (65535: no other label near). */
typedef struct label_voxel {
    uint16_t weight[LABEL_LAYERS];
    uint8_t label[LABEL_LAYERS];
} label_voxel;

/* Connected voxels of one label, corners included. */
typedef struct label_piece {
    int label;
    int64_t voxels;
    double seed_m[3]; /* a point deep inside */
} label_piece;

/* Labels and a margin around them. Points are p = (i,j,k) * spacing of the complete image. */
typedef struct label_field {
    int labels;                    /* labels are 1 to this; 0 is outside */
    int value[LABEL_MAX + 1];      /* value of each label in the image */
    int64_t voxels[LABEL_MAX + 1]; /* after merging specks */
    double face_m2[LABEL_MAX + 1]; /* area of its voxels' outer faces */
    int thin[LABEL_MAX + 1];       /* smallest extent along an axis, voxels */
    int pieces[LABEL_MAX + 1];     /* number of pieces */
    int64_t specks, speck_voxels;  /* pieces merged into their surroundings, and their voxels */
    int size[3], begin[3];         /* of the covered part, in voxels of the image */
    double spacing_m[3];
    uint8_t *at;                /* [size0*size1*size2] label of each voxel */
    label_voxel *voxel;         /* the smoothed labels */
    float sigma[LABEL_MAX + 1]; /* standard deviation of its Gaussian, voxels */
    float bias[LABEL_MAX + 1];  /* added to the label's strength: moves its surface outward */
    label_piece *piece;         /* of all labels, in the order of their first voxel */
    int piece_count;
    bool at_border; /* a label reaches the image's border */
} label_field;

/* Builds the field.
 *
 * `wanted`: values of the image (null: all but 0); a missing one gets voxels 0. Pieces of fewer than `specks` voxels,
 * except the largest of a label, merge into the label that they touch most. `smooth`: standard deviation of the labels'
 * Gaussian, in voxels of each axis (0: none); smaller for thin labels, unless `even`. Returns false if memory is
 * exhausted. */
bool label_field_build(const image_volume *image, const int *wanted, int count, int64_t specks, double smooth,
                       bool even, label_field *out);
void label_field_free(label_field *f);
/* image_label_fn; context is the field. */
int label_field_at(const void *field, const double p[3]);

/* image_between_fn; context is the field. */
bool label_field_between(const void *field, int a, int b, double p[3]);

/* Fills `voxel` from `at`. Private to label_field.c and label_smooth.c. */
bool label_field_smooth(label_field *f, double smooth, bool even);

#endif
