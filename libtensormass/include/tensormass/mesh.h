/* Tetrahedral mesh: rest positions and topology. Built once, then const: cutting marks tetrahedra in the tissue,
 * the mesh keeps its numbering for ever. */
#ifndef TENSORMASS_MESH_H
#define TENSORMASS_MESH_H

#include "base.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_MAX_REGIONS 1048576

/* Whether a mesh keeps the numbers that its vertices are given with. */
typedef enum tm_numbering {
    TM_NUMBERING_ORIGINAL = 0,
    TM_NUMBERING_IMPROVED = 1 /* not where they make steps slow (tm_numbering_stats.should_renumber) */
} tm_numbering;

typedef struct tm_mesh_def {
    uint32_t cookie, size; /* both set by tm_mesh_def_default */
    int32_t vertex_count;
    const double *vertex_m; /* [3*vertex_count] rest positions, m */
    int32_t tet_count;
    const int32_t *tet;    /* [4*tet_count] vertex indices, positive orientation: (p1-p0)x(p2-p0).(p3-p0) > 0 */
    const int32_t *region; /* [tet_count] region of each tetrahedron, 0 to TM_MAX_REGIONS - 1, or null: all 0 */
    /* Where this renumbers, every array of the mesh, and of all that is made on it, is in the mesh's own numbering of
     * vertices, and original_vertex leads back. Tetrahedra, their corners, edges' orders within them and faces keep
     * theirs.
     */
    tm_numbering renumber;
} tm_mesh_def;

/* Topology, all arrays owned by the mesh and constant. "Ascending" orders are part of the contract: every sum over
 * them is in that order, which is what makes a cut tissue equal a fresh build bit for bit. */
typedef struct tm_mesh {
    int32_t vertex_count, tet_count, edge_count, surface_count, region_count;
    double *rest_m;             /* [3*vertex_count] m */
    int32_t *tet;               /* [4*tet_count] */
    int32_t *region;            /* [tet_count] */
    int32_t *edge;              /* [2*edge_count] (k,l) with k<l, sorted lexicographically */
    int32_t *tet_edge;          /* [6*tet_count] edges 01 02 03 12 13 23 */
    int32_t *tet_neighbour;     /* [4*tet_count] tetrahedron across the face opposite local vertex i, -1 outside */
    int32_t *vertex_tet_begin;  /* [vertex_count+1] */
    int32_t *vertex_tet;        /* tetrahedra around a vertex, ascending */
    int32_t *edge_tet_begin;    /* [edge_count+1] */
    int32_t *edge_tet;          /* tetrahedra around an edge, ascending */
    int32_t *vertex_edge_begin; /* [vertex_count+1] */
    int32_t *vertex_edge;       /* edges at a vertex, by ascending neighbour */
    int32_t *surface;           /* [3*surface_count] outer triangles, normals outward, ascending by surface_face */
    int32_t *surface_face;      /* [surface_count] face id = 4*tet + local vertex opposite */
    double *shape_1_m;          /* [12*tet_count] shape vectors alpha_k = grad lambda_k, 1/m */
    double *volume_m3;          /* [tet_count] > 0 */
    int64_t bytes;
    int32_t
        *original_vertex; /* [vertex_count] the def's number of each vertex; null: as given, nothing was renumbered */
} tm_mesh;

TM_API tm_mesh_def tm_mesh_def_default(void);

/* Validates, then builds. Refuses (TM_ERR_MESH, `entity` names it): indices out of range, a vertex twice in one
 * tetrahedron, coordinates not finite, zero or negative volume, a tetrahedron twice, a face shared by three, a vertex
 * without tetrahedra, an empty mesh. TM_ERR_ARGUMENT: `renumber`. `*mesh` is untouched on failure. Errors here and of
 * all that is made on the mesh speak of vertices by their given numbers. */
TM_API tm_status tm_mesh_create(const tm_mesh_def *def, tm_mesh **mesh, tm_error *error);
TM_API void tm_mesh_destroy(tm_mesh *mesh);

/* --- numbering ---
 * A force pass is quick where neighbours have numbers near each other: what it touches is still in the cache, and few
 * edges cross the border between two threads (docs/performance.md, "Numbering"). */

/* The given number of the mesh's vertex: itself where numbering is as given. */
TM_API int32_t tm_mesh_original_vertex(const tm_mesh *mesh, int32_t vertex);
/* Values of vertices, [components*vertex_count] of `components` each, from the mesh's numbering into the given one, and
 * back; copied where these are the same. `from` and `to` are different arrays. */
TM_API void tm_mesh_to_original(const tm_mesh *mesh, int32_t components, const double *from, double *to);
TM_API void tm_mesh_from_original(const tm_mesh *mesh, int32_t components, const double *from, double *to);

/* The order of Cuthill and McKee (1969), reversed. It follows from places and edges alone, not from the numbers that
 * were there, as long as no two vertices lie in one place. `was` [vertex_count]: the mesh's number of each new vertex.
 * False: no memory, `was` undefined. */
TM_API bool tm_mesh_numbering(const tm_mesh *mesh, int32_t *was);
/* The tetrahedra after it: ascending by their lowest vertex, then by the next ones. `was_tet` [tet_count]: the mesh's
 * number of each. False: no memory. */
TM_API bool tm_mesh_numbering_tets(const tm_mesh *mesh, const int32_t *was, int32_t *was_tet);

typedef struct tm_numbering_stats {
    double distance, renumbered; /* mean of |k - l| over the edges (k,l): as given, and in tm_mesh_numbering's order */
    bool should_renumber; /* renumbering is worth it: 200 vertices and more, and more than three times as far apart */
} tm_numbering_stats;
/* False: no memory. */
TM_API bool tm_mesh_numbering_measure(const tm_mesh *mesh, tm_numbering_stats *out);

/* Local vertices of the face opposite local vertex i, ordered so that the normal points outward. */
extern TM_API const int8_t tm_face_vertex[4][3];
/* Local vertices of local edge e: 01 02 03 12 13 23. */
extern TM_API const int8_t tm_edge_vertex[6][2];

/* Quality of one tetrahedron, from rest positions. */
typedef struct tm_tet_quality {
    double volume_m3;
    double aspect; /* longest edge / (2 sqrt(6) inradius): 1 regular, grows without bound */
    double min_dihedral_rad, max_dihedral_rad;
    double min_altitude_m;
} tm_tet_quality;
TM_API tm_tet_quality tm_mesh_tet_quality(const tm_mesh *mesh, int32_t tet);

#ifdef __cplusplus
}
#endif
#endif
