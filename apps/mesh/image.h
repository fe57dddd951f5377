/* tm-mesh image, in parts: what is asked for, meshing to it, what came of it. */
#ifndef MESH_IMAGE_H
#define MESH_IMAGE_H

#include "command.h"
#include "label_field.h"

/* Of one label. */
typedef struct image_region {
    int value;
    char name[64];
    double size_m; /* 0: that of all, or what its thickness asks for */
} image_region;

typedef struct image_options {
    const char *in, *out, *json;
    double size_m, distance_m, smooth, sliver_deg, unit_m; /* 0 where they follow from the rest */
    double young_Pa, poisson, density_kg_m3;
    int64_t specks;
    int budget;         /* tetrahedra; 0: by size; -1: real time */
    double budget_load; /* of a core, for real time */
    bool lloyd, perturb, exude, improve, volumes, allow_vanish, allow_apart, allow_thin, ras;
    bool strict;                        /* lost detail is refused */
    bool budget_said;                   /* by the user; else it is the default */
    bool trial;                         /* nothing is said: what is proposed is tried */
    double trial_until_s;               /* a trial ends then */
    bool even;                          /* all labels are smoothed alike, thin ones, too */
    image_region region[LABEL_MAX + 1]; /* from 1 */
    int regions;                        /* named by --label */
    bool all;                           /* the others stay, too; so they do where none is named */
} image_options;

/* What came of one label. */
typedef struct image_result {
    double volume_m3, image_m3, area_m2;
    double hausdorff_m, mean_m; /* between the mesh's surface of the label and the voxels' */
    int tets, pieces;
    double largest_m3; /* of its pieces */
} image_result;

/* A mesh on the image's grid (p = voxel * spacing) with sizes that were used. */
typedef struct image_mesh {
    image_tets tets;
    double edge_m[LABEL_MAX + 1], surface_m[LABEL_MAX + 1];
    image_result of[LABEL_MAX + 1];
    double size_m, load; /* load: seconds of one core that a simulated second takes; 0: not asked for */
    int passes, loose;   /* loose: parts that were dropped */
    double loose_m3;
} image_mesh;

/* Fills `mesh`; exit code. */
int image_build(const image_api *api, const image_options *o, label_field *field, image_mesh *mesh);
/* Drops parts of the mesh that hang on nothing, that are of labels in more pieces than in the image, and that have less
 * than image_loose_share of its volume. False: no memory. */
bool image_drop_loose(const label_field *field, image_mesh *mesh);
extern const double image_loose_share;
/* Volumes, areas, pieces and tetrahedra of each label. False: no memory. */
bool image_measure(const label_field *field, image_mesh *mesh);
/* Distances of each label's surfaces. */
tm_status image_distances(const label_field *field, image_mesh *mesh, tm_error *error);
/* The mesh of a file: places in the world, regions, the group "surface" and one for every label's outer surface. */
bool image_to_file(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                   tm_mesh_file *out);
/* Fills the field and the mesh of what was asked for; exit code. */
typedef int image_attempt_fn(const image_api *api, image_options *o, const image_volume *volume, label_field *field,
                             image_mesh *mesh);
/* Meshing with more detail that was tried and lost none: words to add to the command; empty: none was found. */
void image_propose(const image_api *api, image_attempt_fn *attempt, const image_options *asked,
                   const image_volume *volume, const label_field *field, const image_mesh *mesh, double took_s,
                   char words[IMAGE_WHY]);
/* Prints, and writes the JSON file if one is asked for; exit code. */
int image_report(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                 const tm_mesh_file *file);
/* Puts `p` onto the surface between two labels (0: outside) nearby; false: there is none. */
typedef bool image_between_fn(const void *shape, int a, int b, double p[3]);
/* Moves vertices so that the smallest tetrahedron grows, those between two labels along the surface that `between`
 * finds. False: no memory. */
bool image_improve(image_tets *m, int labels, image_between_fn *between, const void *shape);
/* Moves the surfaces of labels until each has its voxels' volume, as far as that goes without a tetrahedron that is
 * smaller or has a sharper edge than the worst that was there. False: no memory. */
bool image_fit_volumes(const label_field *field, image_tets *m);
void image_mesh_free(image_mesh *mesh);

/* Outer faces of a label's tetrahedra, as 3 vertices each, normals outwards; malloced. -1: no memory. */
int image_faces(const image_tets *tets, int label, int **face);
/* The same of all labels, those between two of them once for each. */
int image_interfaces(const image_tets *tets, int labels, int **face);

/* The module; null after filling `error`. */
const image_api *image_open_module(tm_error *error);

#endif
