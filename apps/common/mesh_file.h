/* Meshes from files and into files. Which kinds there are: mesh_format.h. */
#ifndef TM_MESH_FILE_H
#define TM_MESH_FILE_H

#include "tensormass/mesh.h"

/* A mesh as a file holds it, vertices and tetrahedra in its order. Regions are 3D physical groups (one unnamed region
 * if there are none); `group` are named sets of vertices: the vertices of every physical group of any dimension. */
typedef struct app_mesh {
    int32_t vertex_count, tet_count, region_count, group_count;
    double *vertex_m;        /* [3*vertex_count], scaled */
    int32_t *tet;            /* [4*tet_count] */
    int32_t *region;         /* [tet_count] */
    char (*region_name)[64]; /* [region_count] */
    char (*group_name)[64];  /* [group_count] */
    int32_t *group_begin;    /* [group_count+1] */
    int32_t *group_vertex;   /* ascending in each group */
    int64_t *vertex_tag;     /* [vertex_count] numbers in the file, for messages */
    int64_t *tet_tag;        /* [tet_count] */
    uint64_t hash;           /* of the file's bytes, its ending and the scale */
} app_mesh;

/* Reads `path`, times `scale`. On failure `error->message` names the file's lines or tags, and nothing is held. What
 * was read may still be no sound mesh: app_mesh_build says. */
tm_status app_mesh_load(const char *path, double scale, app_mesh *mesh, tm_error *error);
/* The same of a file's bytes, which a NUL follows that `size` does not count; `path` gives the ending. */
tm_status app_mesh_parse(const char *path, const char *bytes, size_t size, double scale, app_mesh *mesh,
                         tm_error *error);
/* The whole file or none, by the path's ending. `error->message` names the path. */
tm_status app_mesh_write(const app_mesh *mesh, const char *path, tm_error *error);
/* ".msh .vtk ...": what is read, or what is written. */
const char *app_mesh_endings(bool written);
/* Allocates the arrays for the counts already set. False: no memory, nothing held. */
bool app_mesh_allocate(app_mesh *mesh, int32_t group_vertex_count);
void app_mesh_free(app_mesh *mesh);
/* tm_mesh_create with errors told in the file's own tags. */
tm_status app_mesh_build(const app_mesh *file, tm_mesh **mesh, tm_error *error);

/* Fibres from CSV with a header line "tet,ax,ay,az", tetrahedra counted from 0 in file order, one row each. `*line` is
 * the line to blame. */
tm_status app_fibres_load(const char *path, int32_t tet_count, double *fibre, int *line, tm_error *error);

#endif
