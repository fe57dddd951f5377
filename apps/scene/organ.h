/* A mesh from which a scene is written: its materials, supports and instruments. */
#ifndef SCENE_ORGAN_H
#define SCENE_ORGAN_H

#include "app.h"
#include "tensormass/mesh.h"
#include "tensormass/tissue.h"
#include "tensormass_io.h"
#include "tissues.h"

enum { SUPPORTS_MAX = 16 };

typedef enum support_kind { SUPPORT_GROUP, SUPPORT_VERTICES, SUPPORT_PLANE, SUPPORT_BOX } support_kind;

typedef struct organ_support {
    support_kind kind;
    const char *name; /* name of a group of the mesh, or a word */
    int32_t *vertex, count;
    double point_m[3], normal[3], within_m; /* for a plane */
    double low_m[3], high_m[3];             /* for a box */
    double share;                           /* share of the surface; planes only */
    bool added;                             /* added by organ_hang */
} organ_support;

typedef struct organ {
    tm_mesh_file file;
    tm_mesh *mesh;
    const tissue_constants **tissue; /* [region_count] constants of each region, never null */
    bool *known;                     /* [region_count] the constants were found by the region's name or the title */
    double low_m[3], high_m[3], size_m;
    int up_axis; /* vertical axis: 0 x, 1 y, 2 z */
    double up[3];
    organ_support support[SUPPORTS_MAX];
    int supports;
    double sag_m; /* sag under its own weight on these supports, m; infinite: a connected component has no support */
    bool hangs;   /* the supports suffice */
    /* of the first instrument */
    double target_m[3], trocar_m[3], axis[3], tool_up[3], depth_m;
    const char *aim; /* the structure that it presses, from above */
    bool cut;        /* a second instrument, a cautery, cuts a line near it */
    double cut_from_m[3], cut_to_m[3], cut_trocar_m[3], cut_axis[3], cut_up[3], cut_depth_m;
    /* step with these constants, s */
    double step_s;
    int substeps;
} organ;

/* Reads and measures a mesh. `title` identifies the tissue of regions whose names do not; `cut` requires a step that
 * holds for cut tissue. Returns 0, or an exit code after an error message. */
int organ_load(const char *path, double scale, const char *up, const char *title, bool cut, organ *o);
void organ_free(organ *o);
/* Finds the supports: bone, vessels where they leave the organ, groups by name, a flat side, else the lowest part. */
bool organ_find_supports(organ *o);
/* Computes the sag on these supports and adds some where it is too large. Sets o->sag_m and o->hangs. Returns 0, or an
 * exit code after an error message. */
int organ_hang(const char *path, organ *o);
/* Returns whether a plane or a box holds a position of the undeformed tissue. */
bool organ_holds(const organ_support *support, const double x_m[3]);
/* Creates tissue with the organ's materials; the caller destroys it. */
tm_status organ_tissue(const organ *o, bool cut, tm_tissue **tissue, tm_error *error);
/* Sets mark[vertex] = 1 for each vertex that a support holds. */
void organ_mark_held(const organ *o, uint8_t *mark);
/* Chooses the first instrument's way in as a person would: from above, 0.12 m away, onto the upper surface, away from
 * supports. Returns false if memory is exhausted. */
bool organ_find_trocar(organ *o);
/* Chooses the same for a cautery near it, after organ_find_trocar. o->cut is set if there is enough space. Returns
 * false if memory is exhausted. */
bool organ_find_cut(organ *o);
/* Writes the scene's text. */
void organ_write(const organ *o, FILE *out, const char *mesh_path, double scale, const char *title);

#endif
