/* tm-mesh image: options, meshing, results. */
#ifndef MESH_IMAGE_H
#define MESH_IMAGE_H

#include "command.h"
#include "label_field.h"

/* Options of one label. */
typedef struct image_region {
    int value;
    char name[64];
    double size_m; /* 0: the size of all labels, or the one that follows from its thickness */
} image_region;

typedef struct image_options {
    const char *in, *out, *json;
    double size_m, distance_m, smooth, sliver_deg, unit_m; /* 0: derived from the others */
    double young_Pa, poisson, density_kg_m3;
    int64_t specks;
    int budget;         /* number of tetrahedra; 0: by size; -1: real time */
    double budget_load; /* share of a core, for real time */
    bool lloyd, perturb, exude, improve, volumes, allow_vanish, allow_apart, allow_thin, ras;
    bool strict;                        /* reject lost detail */
    bool budget_said;                   /* set by the user, not the default */
    bool trial;                         /* trial for a proposal: prints nothing */
    double trial_until_s;               /* time at which a trial stops */
    bool even;                          /* smooth all labels equally, thin ones too */
    image_region region[LABEL_MAX + 1]; /* [1..regions] */
    int regions;                        /* labels named by --label */
    bool all;                           /* mesh the other labels too; also if none is named */
} image_options;

/* Result for one label. */
typedef struct image_result {
    double volume_m3, image_m3, area_m2;
    double hausdorff_m, mean_m; /* distance between the label's surfaces in mesh and voxels */
    int tets, pieces;
    double largest_m3; /* of its largest piece */
} image_result;

/* A mesh on the image's grid (p = voxel * spacing), with the sizes used. */
typedef struct image_mesh {
    image_tets tets;
    double edge_m[LABEL_MAX + 1], surface_m[LABEL_MAX + 1];
    image_result of[LABEL_MAX + 1];
    double size_m, load; /* load: core seconds per simulated second; 0: not measured */
    int passes, loose;   /* loose: number of parts removed */
    double loose_m3;
} image_mesh;

/* Fills `mesh`; returns the exit code. */
int image_build(const image_api *api, const image_options *o, label_field *field, image_mesh *mesh);
/* Removes loose parts: parts below image_loose_share of the mesh's volume whose labels all have more pieces than in the
 * image. Returns false if memory is exhausted. */
bool image_drop_loose(const label_field *field, image_mesh *mesh);
extern const double image_loose_share;
/* Computes volume, area, pieces and tetrahedra of each label. Returns false if memory is exhausted. */
bool image_measure(const label_field *field, image_mesh *mesh);
/* Computes the surface distances of each label. */
tm_status image_distances(const label_field *field, image_mesh *mesh, tm_error *error);
/* Makes the mesh of a file: world positions, regions, the group "surface" and one for the outer surface of each
 * label. */
bool image_to_file(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                   tm_mesh_file *out);
/* Fills the field and the mesh for these options; returns the exit code. */
typedef int image_attempt_fn(const image_api *api, image_options *o, const image_volume *volume, label_field *field,
                             image_mesh *mesh);
/* Tries finer meshing that loses no detail. Returns the options to add to the command; empty if none was found. */
void image_propose(const image_api *api, image_attempt_fn *attempt, const image_options *asked,
                   const image_volume *volume, const label_field *field, const image_mesh *mesh, double took_s,
                   char words[IMAGE_WHY]);
/* Prints the report, and writes the JSON file if requested; returns the exit code. */
int image_report(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                 const tm_mesh_file *file);
/* Moves `p` to the nearby surface between two labels (0: outside). Returns false if there is none. */
typedef bool image_between_fn(const void *shape, int a, int b, double p[3]);
/* Moves vertices to enlarge the smallest tetrahedron; those between two labels stay on the surface that `between`
 * finds. Returns false if memory is exhausted. */
bool image_improve(image_tets *m, int labels, image_between_fn *between, const void *shape);
/* Moves the labels' surfaces until each label has the volume of its voxels. No tetrahedron becomes smaller, nor any
 * edge sharper, than the worst at the start. Returns false if memory is exhausted. */
bool image_fit_volumes(const label_field *field, image_tets *m);
void image_mesh_free(image_mesh *mesh);

/* Returns the number of outer faces of a label's tetrahedra, -1 if memory is exhausted. `face`: 3 vertices each,
 * normals outward, malloced. */
int image_faces(const image_tets *tets, int label, int **face);
/* As image_faces for all labels; a face between two labels occurs once for each. */
int image_interfaces(const image_tets *tets, int labels, int **face);

/* Opens the module; returns null after filling `error`. */
const image_api *image_open_module(tm_error *error);

#endif
