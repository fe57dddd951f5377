/* Meshes from files: Gmsh's reader (in a module of its own) behind a cache that never opens it twice. */
#ifndef TM_MESH_FILE_H
#define TM_MESH_FILE_H

#include "tensormass/mesh.h"

/* A mesh as a file holds it. Regions are 3D physical groups (one unnamed region if there are none); `group` are
 * named sets of vertices: the vertices of every physical group of any dimension. */
typedef struct app_mesh {
    int32_t vertex_count, tet_count, region_count, group_count;
    double *vertex_m;        /* [3*vertex_count], scaled */
    int32_t *tet;            /* [4*tet_count] */
    int32_t *region;         /* [tet_count] */
    char (*region_name)[64]; /* [region_count] */
    char (*group_name)[64];  /* [group_count] */
    int32_t *group_begin;    /* [group_count+1] */
    int32_t *group_vertex;
    int64_t *vertex_tag; /* [vertex_count] numbers in the file, for messages */
    int64_t *tet_tag;    /* [tet_count] */
    uint64_t hash;       /* of the file's bytes and scale: the cache's key */
} app_mesh;

/* Reads `path` (.msh 2.2/4.1, .vtk, .mesh), times `scale`. From the cache ($TM_CACHE_DIR, else
 * $XDG_CACHE_HOME/tensormass, else ~/.cache/tensormass) when it holds this file. On failure `error->message` names file
 * tags. */
tm_status app_mesh_load(const char *path, double scale, app_mesh *mesh, tm_error *error);
void app_mesh_free(app_mesh *mesh);
/* tm_mesh_create with errors told in the file's own tags. */
tm_status app_mesh_build(const app_mesh *file, tm_mesh **mesh, tm_error *error);

/* Fibres from CSV with a header line "tet,ax,ay,az", tetrahedra counted from 0 in file order, one row each. `*line` is
 * the line to blame. */
tm_status app_fibres_load(const char *path, int32_t tet_count, double *fibre, int *line, tm_error *error);

#endif
