/* Everything that keeps a mesh from being simulated, told in the tags of its file. */
#ifndef TM_MESH_CHECK_H
#define TM_MESH_CHECK_H

#include "mesh_file.h"

typedef enum app_defect_kind {
    APP_DEFECT_NOT_FINITE,    /* vertex: a coordinate is nan, infinite or absurd */
    APP_DEFECT_VERTEX_TWICE,  /* tet names vertex twice */
    APP_DEFECT_FLAT,          /* tet: no volume to rounding */
    APP_DEFECT_INVERTED,      /* tet: negative volume */
    APP_DEFECT_TET_TWICE,     /* tet has the vertices of tet `other` */
    APP_DEFECT_FACE_SHARED,   /* tet: a face shared with `other` and a third */
    APP_DEFECT_OVERLAP,       /* tet and `other` lie on one side of a common face */
    APP_DEFECT_UNUSED_VERTEX, /* vertex: in no tetrahedron */
    APP_DEFECT_KINDS
} app_defect_kind;

typedef struct app_defect {
    app_defect_kind kind;
    int32_t vertex, tet, other; /* indices from 0, -1: does not apply */
} app_defect;

/* Writes up to `room` defects, by kind, then ascending; returns how many there are in all, -1: no memory. */
int64_t app_mesh_defects(const app_mesh *mesh, app_defect *defect, int64_t room);
/* "tetrahedron 12 (vertices 1 2 3 4) is flat; move a vertex, or run tm-mesh repair" */
void app_defect_text(const app_mesh *mesh, const app_defect *defect, char *text, int size);
/* "flat", "inverted", ... */
const char *app_defect_name(app_defect_kind kind);

/* Six times the volume, and what of it may be rounding: tm_mesh_create's own measure of flat. */
double app_tet_volume6(const app_mesh *mesh, int32_t tet, double *rounding);

#endif
