/* libtensormass_io: reads and writes tetrahedral meshes (.msh 2.2 and 4.1, .vtk, .mesh; writes .vtu), reports their
 * defects, and reads fibre directions from CSV. Depends on libtensormass, the C library and libm. Never prints or
 * exits, and is independent of the process's locale. Its own memory is malloc's.
 *
 * Messages about a file are "file:line: what; what to do". Binary files have no line; a long path is shortened to its
 * end. Messages about a mesh from no file are "what; what to do". Pages: docs/mesh-formats.md. */
#ifndef TENSORMASS_IO_H
#define TENSORMASS_IO_H

#include <stdio.h>

#include "tensormass/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- meshes --- */

/* A mesh as in its file, vertices and tetrahedra in the file's order. Regions are 3D physical groups (one unnamed
 * region if there are none). `group` are named sets of vertices: those of all physical groups of all dimensions. All
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
    uint64_t hash;           /* of the file's bytes, ending and scale */
    char *path;              /* source, for messages; null: no file */
    double *fibre;           /* [3*tet_count] unit vectors that are written too, malloced; null: none. Never read from a
                              * file */
} tm_mesh_file;

/* Reads the regular file `path`, times `scale` > 0, metres per unit of the file. Returns TM_ERR_FILE if it cannot be
 * read, is damaged or truncated, or does not match its ending. Returns TM_ERR_MESH (`entity`: its number in the file)
 * for elements other than tetrahedra, a missing vertex, or a number used twice. Returns TM_ERR_ARGUMENT for the scale,
 * or TM_ERR_MEMORY. On failure `*file` is all zero. The result may still be an invalid mesh: tm_mesh_file_build checks
 * that. */
TM_API tm_status tm_mesh_file_load(const char *path, double scale, tm_mesh_file *file, tm_error *error);
/* Parses a file's bytes in the same way; bytes[size] must be readable and 0. `path` gives the ending and the name in
 * messages. */
TM_API tm_status tm_mesh_file_parse(const char *path, const char *bytes, size_t size, double scale, tm_mesh_file *file,
                                    tm_error *error);
/* Writes all of it to `stream`, in metres, in the format of `path`'s ending; `path` is not opened. Returns TM_ERR_FILE
 * if there is no such format or the stream failed. */
TM_API tm_status tm_mesh_file_write(const tm_mesh_file *file, const char *path, FILE *stream, tm_error *error);
/* Returns ".msh .vtk ...": the endings that can be read, or written. */
TM_API const char *tm_mesh_file_endings(bool written);
/* Allocates a mesh from no file, for writing: zeroed arrays for the four counts already set. Previous arrays and path
 * are dropped, not freed. `group_vertex_count` is the total over all groups. Returns false if memory is exhausted;
 * nothing is allocated then. */
TM_API bool tm_mesh_file_allocate(tm_mesh_file *file, int32_t group_vertex_count);
/* Frees the arrays, not the struct, and zeroes it. */
TM_API void tm_mesh_file_free(tm_mesh_file *file);
/* Removes the tetrahedra whose keep[tet_count] is 0, and the vertices without a tetrahedron; regions and groups stay,
 * empty ones too. `kept` [tet_count] receives the old number of each remaining tetrahedron; may be null. Returns false
 * if memory is exhausted; nothing is changed then. */
TM_API bool tm_mesh_file_subset(tm_mesh_file *file, const uint8_t *keep, int32_t *kept);
/* Builds a mesh by tm_mesh_create, with errors in the file's numbers. On failure `*mesh` is unchanged. */
TM_API tm_status tm_mesh_file_build(const tm_mesh_file *file, tm_mesh **mesh, tm_error *error);
/* The same with tm_mesh_def.renumber. The file's own arrays and groups keep its numbering (tm_mesh_original_vertex). */
TM_API tm_status tm_mesh_file_build_numbered(const tm_mesh_file *file, tm_numbering renumber, tm_mesh **mesh,
                                             tm_error *error);

/* --- surfaces --- */

/* Reads the triangles of a surface in VTK's formats: .vtp, and .vtu or .vtk of triangles and polygons (convex ones,
 * split into fans). `*corner` [9*triangles], in the file's units, is malloced. Returns TM_ERR_FILE or TM_ERR_MESH as
 * tm_mesh_file_load; nothing is allocated then. */
TM_API tm_status tm_surface_load(const char *path, double **corner, int32_t *triangles, tm_error *error);

/* --- defects that prevent simulation --- */

typedef enum tm_mesh_defect_kind {
    TM_DEFECT_NOT_FINITE,    /* vertex: a coordinate is nan, infinite or absurd */
    TM_DEFECT_VERTEX_TWICE,  /* tet names vertex twice */
    TM_DEFECT_FLAT,          /* tet: volume zero within rounding */
    TM_DEFECT_INVERTED,      /* tet: negative volume */
    TM_DEFECT_TET_TWICE,     /* tet has the vertices of tet `other` */
    TM_DEFECT_FACE_SHARED,   /* tet: a face shared with `other` and a third */
    TM_DEFECT_OVERLAP,       /* tet and `other` are on the same side of a common face */
    TM_DEFECT_UNUSED_VERTEX, /* vertex: in no tetrahedron */
    TM_DEFECT_KINDS
} tm_mesh_defect_kind;

typedef struct tm_mesh_defect {
    tm_mesh_defect_kind kind;
    int32_t vertex, tet, other; /* indices from 0, -1: does not apply */
} tm_mesh_defect;

/* Writes up to `room` defects, by kind, then ascending. Returns the total number, -1 if memory is exhausted. 0 exactly
 * if tm_mesh_create accepts the mesh. */
TM_API int64_t tm_mesh_file_defects(const tm_mesh_file *mesh, tm_mesh_defect *defect, int64_t room);
/* Writes "tetrahedron 12 (vertices 1 2 3 4) is flat; move a vertex, or run tm-mesh repair", at most `size` bytes with
 * the 0. */
TM_API void tm_mesh_defect_text(const tm_mesh_file *mesh, const tm_mesh_defect *defect, char *text, int size);
/* Returns "flat", "inverted", ... */
TM_API const char *tm_mesh_defect_name(tm_mesh_defect_kind kind);

/* --- fibres --- */

/* Reads unit vectors `fibre` [3*tet_count] from CSV with a header line "tet,ax,ay,az": one row per tetrahedron, counted
 * from 0 in file order. On TM_ERR_FILE, `entity` is the tetrahedron of the bad row, else -1; `fibre` then has the rows
 * before it. */
TM_API tm_status tm_fibres_load(const char *path, int32_t tet_count, double *fibre, tm_error *error);
/* The same; also accepts the header "vertex,ax,ay,az" with one row per vertex. A tetrahedron's fibre is then the mean
 * of its vertices', with signs aligned (a fibre has no direction). Vertices have their original numbers. May return
 * TM_ERR_MEMORY. */
TM_API tm_status tm_fibres_load_on(const char *path, const tm_mesh *mesh, double *fibre, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
