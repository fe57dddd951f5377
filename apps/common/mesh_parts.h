/* Inside the mesh loader: what its files share. Programs use mesh_file.h. */
#ifndef TM_MESH_PARTS_H
#define TM_MESH_PARTS_H

#include "mesh_file.h"

/* What a loader may pass over, for tm-mesh repair. Programs that simulate pass null. */
typedef struct app_mesh_lenient {
    int64_t dropped_vertices; /* out: vertices that no element used, left behind by the reader */
} app_mesh_lenient;
tm_status app_mesh_load_lenient(const char *path, double scale, app_mesh_lenient *lenient, app_mesh *mesh,
                                tm_error *error);

/* Allocates the arrays for the counts already set. False: no memory, nothing held. */
bool app_mesh_allocate(app_mesh *mesh, int32_t group_vertex_count);

/* One block of bytes for cache and pipe: versioned, checksummed, carrying `hash`. */
void *app_mesh_encode(const app_mesh *mesh, size_t *size);
/* TM_ERR_FILE for anything that is not a whole, sound block of this version with this hash. */
tm_status app_mesh_decode(const void *bytes, size_t size, uint64_t hash, app_mesh *mesh, tm_error *error);

/* The cache on disk. Both are quiet: a cache that cannot be used is no error. */
bool app_mesh_cache_load(uint64_t hash, app_mesh *mesh);
void app_mesh_cache_store(const app_mesh *mesh);

/* What Gmsh's reader forgets of a .msh: the tags in the order of the file, vertices that no element uses. */
typedef struct app_mesh_scan {
    int64_t *vertex_tag, *tet_tag;   /* null: not told by this kind of file */
    int64_t vertex_count, tet_count; /* -1: likewise */
    bool vtk_5;                      /* not for Gmsh: app_mesh_read_vtk */
} app_mesh_scan;
/* `text` ends in a NUL that is not counted in `size`. Refuses what is cut short, elements that are no first-order
 * tetrahedra, tags that come twice. */
tm_status app_mesh_scan_msh(const char *text, size_t size, app_mesh_scan *scan, tm_error *error);
void app_mesh_scan_free(app_mesh_scan *scan);
/* A legacy VTK file of version 5.0 or later into a mesh in ascending tag order, unscaled. `text` as above. */
tm_status app_mesh_read_vtk(const char *text, size_t size, app_mesh_scan *scan, app_mesh *mesh, tm_error *error);

/* Shared by the scanners of text and of binary files. */
typedef struct app_mesh_cursor {
    const char *at, *end;
    int line; /* 0 in a binary file */
    app_mesh_scan *scan;
    tm_error *error;
    int64_t *sorted; /* the vertex tags, ascending, once they are known */
} app_mesh_cursor;
tm_status app_mesh_scan_binary(app_mesh_cursor *cursor, int major);
tm_status app_mesh_scan_element(app_mesh_cursor *cursor, int64_t tag, int64_t type);
int app_mesh_type_vertices(int64_t type);
/* Sorts the vertex tags for the next; refuses one that comes twice. */
tm_status app_mesh_scan_vertices_end(app_mesh_cursor *cursor);
tm_status app_mesh_scan_corner(app_mesh_cursor *cursor, int64_t element, int64_t vertex);
bool app_mesh_append(int64_t **array, int64_t *count, int64_t value);

/* Entry point of the gmsh module: reads into a mesh in ascending tag order, unscaled. */
typedef tm_status app_gmsh_read_fn(const char *path, app_mesh *mesh, tm_error *error);

tm_status app_mesh_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

#endif
