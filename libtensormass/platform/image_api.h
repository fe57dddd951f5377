/* API of the module `image`: reads label images (ITK), reads and repairs surfaces and makes tetrahedra (CGAL). CGAL's
 * mesher is under the GPL 3, and so is the module; no other part of tensormass links it. Only `make image` builds
 * it. */
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

/* Labels on a grid. Centre of voxel (i,j,k), m: origin + direction * (i,j,k * spacing). */
typedef struct image_volume {
    int size[3];
    double spacing_m[3], origin_m[3], direction[9]; /* columns are the axes' unit vectors, row-major; LPS */
    uint16_t *label;                                /* [size0*size1*size2], the first axis fastest; malloced */
    char unit[16];                                  /* as in the file, "" if missing */
    char kind[24];                                  /* "NiftiImageIO" ... */
    int names;                                      /* names of labels in the file (3D Slicer's .seg.nrrd) */
    struct {
        int label;
        char name[64];
    } name[IMAGE_NAMES];
} image_volume;

/* Returns the label at a place, 0 outside. Must always return the same. */
typedef int image_label_fn(const void *context, const double p[3]);

typedef struct image_domain {
    image_label_fn *label;
    const void *context;
    double low_m[3], high_m[3]; /* box around all labels */
    int seeds;
    const double *seed_m; /* [3*seeds] a place in each component of each label */
    double march_m;       /* step length from a seed that misses no component */
} image_domain;

typedef struct image_request {
    int labels;              /* labels are 1 to this */
    const double *edge_m;    /* [labels+1] approximate edge length of a label's tetrahedra */
    const double *surface_m; /* [labels+1] maximum distance of the facets from its surface */
    double facet_angle_deg, radius_edge;
    bool lloyd, perturb, exude;
    int sweeps;        /* sweeps of Lloyd's method */
    double sliver_deg; /* perturb and exude skip elements without a smaller dihedral angle */
    /* Called often with the present task and its progress; returns false to stop. */
    bool (*go_on)(void *context, const char *doing, int vertices);
    void *go_on_context;
} image_request;

typedef struct image_tets {
    int vertices, tets;
    double *vertex_m; /* [3*vertices] malloced */
    int *tet;         /* [4*tets] positive orientation */
    int *label;       /* [tets] */
} image_tets;

/* Triangles with separate corners. */
typedef struct image_surface {
    int triangles;
    double *corner; /* [9*triangles] malloced */
} image_surface;

typedef struct image_defects {
    int holes, hole_edges;             /* closed rows of edges with only one triangle; edges of the longest */
    int crossings;                     /* pairs of intersecting triangles */
    double hole_at[3], crossing_at[3]; /* centre of the longest hole; of one intersecting triangle */
} image_defects;

typedef enum image_end { IMAGE_DONE, IMAGE_STOPPED, IMAGE_BAD_INPUT, IMAGE_NO_MEMORY, IMAGE_FAILED } image_end;

typedef struct image_api {
    /* Each function runs in a child process with limits (box.h). A crash or an exceeded limit gives IMAGE_BAD_INPUT
     * with a message; a signal that the caller handles gives IMAGE_STOPPED. */
    /* Reads NIfTI, NRRD, MetaImage by ITK, DICOM-SEG by GDCM. `unit_m`: metres per unit of a file without units, 0: mm.
     * `why` is one line. */
    image_end (*read)(const char *path, double unit_m, image_volume *out, char why[IMAGE_WHY]);
    /* Makes tetrahedra of all labels, conforming between them. */
    image_end (*mesh)(const image_domain *domain, const image_request *request, image_tets *out, char why[IMAGE_WHY]);
    /* Reads OBJ, PLY, OFF, STL by ending, in the file's units; polygons become triangles. */
    image_end (*read_surface)(const char *path, image_surface *out, char why[IMAGE_WHY]);
    /* Finds the defects of a surface. `repair` orients it, stitches it, removes intersecting triangles and fills holes;
     * `left` has the defects after that. */
    image_end (*examine_surface)(image_surface *surface, bool repair, image_defects *found, image_defects *left,
                                 char why[IMAGE_WHY]);
} image_api;

/* Vectors on a grid, such as the principal direction of diffusion; placed as in image_volume. */
typedef struct image_vectors {
    int size[3];
    double spacing_m[3], origin_m[3], direction[9];
    float *vector; /* [3*size0*size1*size2] as in the file, the first axis fastest; malloced */
} image_vectors;

/* A separate symbol: its users need no other part of the module. */
#define IMAGE_VECTORS_SYMBOL "image_vectors_1"
typedef struct image_vectors_api {
    /* Reads NIfTI with 3 numbers per voxel (5-D, or a 4-D whose fourth size is 3). A missing unit is mm. `why` is one
     * line. */
    image_end (*read)(const char *path, image_vectors *out, char why[IMAGE_WHY]);
} image_vectors_api;

#ifdef __cplusplus
}
#endif
#endif
