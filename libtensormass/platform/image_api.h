/* What the module `image` gives: label images read by ITK, surfaces read and repaired and tetrahedra by CGAL. CGAL's
 * mesher is under the GPL 3, and so is the module; nothing else of tensormass links it. Built by `make image` alone. */
#ifndef IMAGE_API_H
#define IMAGE_API_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define IMAGE_API_SYMBOL "image_api_2"

enum { IMAGE_WHY = 500, IMAGE_NAMES = 256 };

/* Labels on a grid. Place of voxel (i,j,k)'s centre, m: origin + direction * (i,j,k * spacing). */
typedef struct image_volume {
    int size[3];
    double spacing_m[3], origin_m[3], direction[9]; /* columns are the axes' unit vectors, row-major; LPS */
    uint16_t *label;                                /* [size0*size1*size2], the first axis fastest; malloced */
    char unit[16];                                  /* as the file says, "" if it does not */
    char kind[24];                                  /* "NiftiImageIO" ... */
    int names;                                      /* that the file gives its labels (3D Slicer's .seg.nrrd) */
    struct {
        int label;
        char name[64];
    } name[IMAGE_NAMES];
} image_volume;

/* Which label is at a place: 0 outside. Must be the same for ever. */
typedef int image_label_fn(const void *context, const double p[3]);

typedef struct image_domain {
    image_label_fn *label;
    const void *context;
    double low_m[3], high_m[3]; /* every label lies within */
    int seeds;
    const double *seed_m; /* [3*seeds] a place in every piece of every label */
    double march_m;       /* from a seed, steps that pass over no piece */
} image_domain;

typedef struct image_wish {
    int labels;              /* labels are 1 to this */
    const double *edge_m;    /* [labels+1] of a label's tetrahedra, about */
    const double *surface_m; /* [labels+1] how far the facets may be from its surface */
    double facet_angle_deg, radius_edge;
    bool lloyd, perturb, exude;
    int sweeps;        /* of lloyd */
    double sliver_deg; /* perturb and exude leave alone what has no smaller dihedral angle */
    /* Called all the time with what is done and how far; false: end. */
    bool (*go_on)(void *context, const char *doing, int vertices);
    void *go_on_context;
} image_wish;

typedef struct image_tets {
    int vertices, tets;
    double *vertex_m; /* [3*vertices] malloced */
    int *tet;         /* [4*tets] positive orientation */
    int *label;       /* [tets] */
} image_tets;

/* Triangles, each with its own corners. */
typedef struct image_surface {
    int triangles;
    double *corner; /* [9*triangles] malloced */
} image_surface;

typedef struct image_defects {
    int holes, hole_edges;             /* rows of edges with one triangle alone; edges of the longest */
    int crossings;                     /* pairs of triangles that cut each other */
    double hole_at[3], crossing_at[3]; /* the middle of the longest hole; of one such triangle */
} image_defects;

typedef enum image_end { IMAGE_DONE, IMAGE_STOPPED, IMAGE_BAD_INPUT, IMAGE_NO_MEMORY, IMAGE_FAILED } image_end;

typedef struct image_api {
    /* Every function works in a child process with limits (box.h): a crash or a limit there is IMAGE_BAD_INPUT with a
     * sentence, a signal that the caller handles IMAGE_STOPPED. */
    /* NIfTI, NRRD, MetaImage, by ITK; DICOM-SEG, by GDCM. `unit_m`: metres per unit of a file that says none, 0: mm.
     * `why` is one line. */
    image_end (*read)(const char *path, double unit_m, image_volume *out, char why[IMAGE_WHY]);
    /* Tetrahedra of all labels, conformal between them. */
    image_end (*mesh)(const image_domain *domain, const image_wish *wish, image_tets *out, char why[IMAGE_WHY]);
    /* OBJ, PLY, OFF, STL by ending, in the file's units; polygons become triangles. */
    image_end (*read_surface)(const char *path, image_surface *out, char why[IMAGE_WHY]);
    /* What is wrong with a surface. `repair`: it is turned alike, stitched, rid of triangles that cut each other, and
     * its holes are filled; `left` is what is wrong then. */
    image_end (*examine_surface)(image_surface *surface, bool repair, image_defects *found, image_defects *left,
                                 char why[IMAGE_WHY]);
} image_api;

/* Vectors on a grid, such as the principal direction of diffusion; placed as image_volume. */
typedef struct image_vectors {
    int size[3];
    double spacing_m[3], origin_m[3], direction[9];
    float *vector; /* [3*size0*size1*size2] as the file has them, the first axis fastest; malloced */
} image_vectors;

/* A symbol of its own: who asks for it needs no other part of the module. */
#define IMAGE_VECTORS_SYMBOL "image_vectors_1"
typedef struct image_vectors_api {
    /* NIfTI, of 3 numbers a voxel (5-D, or a 4-D whose fourth size is 3). A unit that is not said is mm. `why` is one
     * line. */
    image_end (*read)(const char *path, image_vectors *out, char why[IMAGE_WHY]);
} image_vectors_api;

#ifdef __cplusplus
}
#endif
#endif
