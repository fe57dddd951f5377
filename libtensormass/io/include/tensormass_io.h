/* libtensormass_io: tetrahedral meshes from files and into files (.msh 2.2 and 4.1, .vtk, .mesh; .vtu out), their
 * defects, and fibre directions from CSV. Depends on libtensormass, the C library and libm; prints nothing, exits
 * nowhere, and does not care about the process's locale. Its own memory is malloc's.
 *
 * Messages about a file are "file:line: what; what to do" (the line where there is one: not in binary files; a long
 * path is told by its end); those about a mesh that came from none are "what; what to do". Pages: docs/mesh-formats.md.
 */
#ifndef TENSORMASS_IO_H
#define TENSORMASS_IO_H

#include <stdio.h>

#include "tensormass/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- meshes --- */

/* A mesh as a file holds it, vertices and tetrahedra in its order. Regions are 3D physical groups (one unnamed region
 * if there are none); `group` are named sets of vertices: the vertices of every physical group of any dimension. All
 * zero: no mesh. */
typedef struct tm_mesh_file {
    int32_t vertex_count, tet_count, region_count, group_count;
    double *vertex_m;        /* [3*vertex_count], scaled */
    int32_t *tet;            /* [4*tet_count] vertices, from 0 */
    int32_t *region;         /* [tet_count] */
    char (*region_name)[64]; /* [region_count] */
    char (*group_name)[64];  /* [group_count] */
    int32_t *group_begin;    /* [group_count+1] */
    int32_t *group_vertex;   /* ascending in each group */
    int64_t *vertex_tag;     /* [vertex_count] numbers in the file, for messages */
    int64_t *tet_tag;        /* [tet_count] */
    uint64_t hash;           /* of the file's bytes, its ending and the scale */
    char *path;              /* where it came from, for messages; null: it came from no file */
    double *fibre;           /* [3*tet_count] unit vectors that are written too, malloced; null: none. Not read */
} tm_mesh_file;

/* Reads `path`, a regular file, times `scale` > 0, metres per unit of the file. TM_ERR_FILE: cannot be read, damaged,
 * cut short, or of a kind that its ending does not say. TM_ERR_MESH (`entity` its number in the file): elements that
 * are no tetrahedra, a vertex that is not there, a number twice. TM_ERR_ARGUMENT: the scale. TM_ERR_MEMORY. On failure
 * `*file` is all zero. What was read may still be no sound mesh: tm_mesh_file_build says. */
TM_API tm_status tm_mesh_file_load(const char *path, double scale, tm_mesh_file *file, tm_error *error);
/* The same of a file's bytes; bytes[size] must be readable and 0. `path` gives the ending, and messages name it. */
TM_API tm_status tm_mesh_file_parse(const char *path, const char *bytes, size_t size, double scale, tm_mesh_file *file,
                                    tm_error *error);
/* Writes all of it as the kind of file that `path` ends like, in metres. TM_ERR_FILE: there is no such kind, or the
 * stream could not take it. `path` is not opened: `stream` is where it goes. */
TM_API tm_status tm_mesh_file_write(const tm_mesh_file *file, const char *path, FILE *stream, tm_error *error);
/* ".msh .vtk ...": what is read, or what is written. */
TM_API const char *tm_mesh_file_endings(bool written);
/* For a mesh that comes from no file and is to be written: allocates the arrays for the four counts already set, all
 * zero, and forgets the arrays and the path that were there; `group_vertex_count` is what all groups hold together.
 * False: no memory, nothing held. */
TM_API bool tm_mesh_file_allocate(tm_mesh_file *file, int32_t group_vertex_count);
/* Frees the arrays, not the struct, which is all zero then. */
TM_API void tm_mesh_file_free(tm_mesh_file *file);
/* tm_mesh_create with errors told in the file's own numbers. `*mesh` is untouched on failure. */
TM_API tm_status tm_mesh_file_build(const tm_mesh_file *file, tm_mesh **mesh, tm_error *error);
/* The same with tm_mesh_def.renumber. The file's own arrays, groups too, stay in its numbering
 * (tm_mesh_original_vertex). */
TM_API tm_status tm_mesh_file_build_numbered(const tm_mesh_file *file, tm_numbering renumber, tm_mesh **mesh,
                                             tm_error *error);

/* --- surfaces --- */

/* The triangles of a surface in VTK's formats: .vtp, and .vtu or .vtk of triangles and polygons (convex: they are cut
 * into fans). `*corner` [9*triangles], in the file's numbers, is malloced. TM_ERR_FILE and TM_ERR_MESH as
 * tm_mesh_file_load; nothing is held then. */
TM_API tm_status tm_surface_load(const char *path, double **corner, int32_t *triangles, tm_error *error);

/* --- what keeps a mesh from being simulated --- */

typedef enum tm_mesh_defect_kind {
    TM_DEFECT_NOT_FINITE,    /* vertex: a coordinate is nan, infinite or absurd */
    TM_DEFECT_VERTEX_TWICE,  /* tet names vertex twice */
    TM_DEFECT_FLAT,          /* tet: no volume to rounding */
    TM_DEFECT_INVERTED,      /* tet: negative volume */
    TM_DEFECT_TET_TWICE,     /* tet has the vertices of tet `other` */
    TM_DEFECT_FACE_SHARED,   /* tet: a face shared with `other` and a third */
    TM_DEFECT_OVERLAP,       /* tet and `other` lie on one side of a common face */
    TM_DEFECT_UNUSED_VERTEX, /* vertex: in no tetrahedron */
    TM_DEFECT_KINDS
} tm_mesh_defect_kind;

typedef struct tm_mesh_defect {
    tm_mesh_defect_kind kind;
    int32_t vertex, tet, other; /* indices from 0, -1: does not apply */
} tm_mesh_defect;

/* Writes up to `room` defects, by kind, then ascending; returns how many there are in all, -1: no memory. 0 exactly
 * where tm_mesh_create takes the mesh. */
TM_API int64_t tm_mesh_file_defects(const tm_mesh_file *mesh, tm_mesh_defect *defect, int64_t room);
/* "tetrahedron 12 (vertices 1 2 3 4) is flat; move a vertex, or run tm-mesh repair", at most `size` bytes with the 0.
 */
TM_API void tm_mesh_defect_text(const tm_mesh_file *mesh, const tm_mesh_defect *defect, char *text, int size);
/* "flat", "inverted", ... */
TM_API const char *tm_mesh_defect_name(tm_mesh_defect_kind kind);

/* --- fibres --- */

/* Unit vectors `fibre` [3*tet_count] from CSV with a header line "tet,ax,ay,az", tetrahedra counted from 0 in file
 * order, one row each. TM_ERR_FILE, `entity` the tetrahedron whose row is to blame, else -1; `fibre` then holds what
 * came before. */
TM_API tm_status tm_fibres_load(const char *path, int32_t tet_count, double *fibre, tm_error *error);
/* The same, or with the header "vertex,ax,ay,az" a row a vertex: a tetrahedron's is then the mean of its vertices',
 * either way round (a fibre has no front). Vertices are counted as the mesh was given. TM_ERR_MEMORY. */
TM_API tm_status tm_fibres_load_on(const char *path, const tm_mesh *mesh, double *fibre, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
