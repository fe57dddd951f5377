/* A mesh on its way to a scene: what it is made of, what holds it, where an instrument comes in. */
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
    const char *name; /* a group's of the mesh, or a word */
    int32_t *vertex, count;
    double point_m[3], normal[3], within_m; /* of a plane */
    double low_m[3], high_m[3];             /* of a box */
    double share;                           /* of the surface: planes */
    bool added;                             /* by organ_hang */
} organ_support;

typedef struct organ {
    tm_mesh_file file;
    tm_mesh *mesh;
    const tissue_constants **tissue; /* [region_count] never null */
    bool *known;                     /* [region_count] found by its name, or the title */
    double low_m[3], high_m[3], size_m;
    int up_axis; /* 0 1 2 */
    double up[3];
    organ_support support[SUPPORTS_MAX];
    int supports;
    double sag_m; /* under its own weight, so held; infinite: a piece of it is held by nothing */
    bool hangs;   /* by enough */
    /* the first instrument */
    double target_m[3], trocar_m[3], axis[3], tool_up[3], depth_m;
    const char *aim; /* what it presses above */
    bool cut;        /* a second one, a cautery, cuts from one place to another beside that */
    double cut_from_m[3], cut_to_m[3], cut_trocar_m[3], cut_axis[3], cut_up[3], cut_depth_m;
    /* the pace that these constants give */
    double step_s;
    int substeps;
} organ;

/* Reads and measures; `title` tells the tissue of regions whose own names do not, `cut` that its pace must hold where
 * it is cut. 0 or an exit code, having complained.
 */
int organ_load(const char *path, double scale, const char *up, const char *title, bool cut, organ *o);
void organ_free(organ *o);
/* What holds it: bone, vessels where they leave it, what its groups' names say, a flat side, else what lies lowest. */
bool organ_find_supports(organ *o);
/* Hangs it up by its supports, and adds some where it sags too far: o->sag_m, o->hangs. 0 or an exit code, having
 * complained. */
int organ_hang(const char *path, organ *o);
/* A plane or a box; of a place at rest. */
bool organ_holds(const organ_support *support, const double x_m[3]);
/* Of its materials; to be destroyed. */
tm_status organ_tissue(const organ *o, bool cut, tm_tissue **tissue, tm_error *error);
/* mark[vertex_count] := 1 where one of them holds. */
void organ_mark_held(const organ *o, uint8_t *mark);
/* Where an instrument comes in, as a person would have it: from above, a hand's breadth away, onto the upper surface,
 * not beside what is held. False: no memory. */
bool organ_find_trocar(organ *o);
/* The same of a cautery beside it, after organ_find_trocar; o->cut says whether there was room. False: no memory. */
bool organ_find_cut(organ *o);
/* The scene's text. */
void organ_write(const organ *o, FILE *out, const char *mesh_path, double scale, const char *title);

#endif
