/* Tetrahedral mesh: rest positions and topology. Built once, then constant. Cutting marks tetrahedra in the tissue; the
 * mesh always keeps its numbering. */
#ifndef TENSORMASS_MESH_H
#define TENSORMASS_MESH_H

#include "base.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_MAX_REGIONS 1048576

/* Numbering of the vertices that tm_mesh_create gives a mesh. */
typedef enum tm_numbering {
    TM_NUMBERING_ORIGINAL = 0,
    TM_NUMBERING_IMPROVED =
        1 /* renumber if the original numbering makes steps slow (tm_numbering_stats.should_renumber) */
} tm_numbering;

typedef struct tm_mesh_def {
    uint32_t cookie, size; /* both set by tm_mesh_def_default */
    int32_t vertex_count;
    const double *vertex_m; /* [3*vertex_count] rest positions, m */
    int32_t tet_count;
    const int32_t *tet;    /* [4*tet_count] vertex indices, positive orientation: (p1-p0)x(p2-p0).(p3-p0) > 0 */
    const int32_t *region; /* [tet_count] region of each tetrahedron, 0 to TM_MAX_REGIONS - 1, or null: all 0 */
    /* If vertices are renumbered, every array of the mesh and of all objects built on it uses the mesh's numbering;
     * original_vertex maps back. Tetrahedra, their corners, their local edge order and faces keep theirs. */
    tm_numbering renumber;
} tm_mesh_def;

/* Topology. All arrays are owned by the mesh and constant. "Ascending" orders are part of the contract: every sum
 * follows them, so that cut tissue equals a fresh build bit for bit. */
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
    int32_t *surface;           /* [3*surface_count] boundary triangles, normals outward, ascending by surface_face */
    int32_t *surface_face;      /* [surface_count] face id = 4*tet + local vertex opposite */
    double *shape_1_m;          /* [12*tet_count] shape vectors alpha_k = grad lambda_k, 1/m */
    double *volume_m3;          /* [tet_count] > 0 */
    int64_t bytes;
    int32_t *original_vertex; /* [vertex_count] original number of each vertex; null: not renumbered */
} tm_mesh;

TM_API tm_mesh_def tm_mesh_def_default(void);

/* Validates the definition, then builds the mesh. TM_ERR_MESH, with the `entity`: an index out of range, a vertex twice
 * in a tetrahedron, a coordinate not finite, volume zero or negative, a tetrahedron twice, a face shared by three, a
 * vertex without tetrahedra, an empty mesh. TM_ERR_ARGUMENT: `renumber`. `*mesh` is unchanged on failure. All errors,
 * also those of objects built on the mesh, give original vertex numbers. */
TM_API tm_status tm_mesh_create(const tm_mesh_def *def, tm_mesh **mesh, tm_error *error);
TM_API void tm_mesh_destroy(tm_mesh *mesh);

/* --- numbering ---
 * A force pass is fast if neighbours have close numbers: their data is still in the cache, and few edges cross the
 * border between two threads (docs/performance.md, "Numbering"). */

/* Returns the original number of a vertex of the mesh: its own number if there was no renumbering. */
TM_API int32_t tm_mesh_original_vertex(const tm_mesh *mesh, int32_t vertex);
/* Convert values of vertices, [components*vertex_count], from the mesh's numbering to the original one, and back. If
 * the two are equal, the values are copied. `from` and `to` must be different arrays. */
TM_API void tm_mesh_to_original(const tm_mesh *mesh, int32_t components, const double *from, double *to);
TM_API void tm_mesh_from_original(const tm_mesh *mesh, int32_t components, const double *from, double *to);

/* Computes the reverse order of Cuthill and McKee (1969). It depends on positions and edges only, not on the present
 * numbers, provided that no two vertices coincide. `was` [vertex_count]: the mesh's number of each new vertex. Returns
 * false if memory is exhausted; `was` is then undefined. */
TM_API bool tm_mesh_numbering(const tm_mesh *mesh, int32_t *was);
/* Computes the order of the tetrahedra after it: ascending by their lowest vertex, then by the next ones. `was_tet`
 * [tet_count]: the mesh's number of each. Returns false if memory is exhausted. */
TM_API bool tm_mesh_numbering_tets(const tm_mesh *mesh, const int32_t *was, int32_t *was_tet);

typedef struct tm_numbering_stats {
    double distance, renumbered; /* mean of |k - l| over the edges (k,l): now, and in tm_mesh_numbering's order */
    bool
        should_renumber; /* at least 200 vertices, and the mean distance more than three times larger than renumbered */
} tm_numbering_stats;
/* Computes the statistics. Returns false if memory is exhausted. */
TM_API bool tm_mesh_numbering_measure(const tm_mesh *mesh, tm_numbering_stats *out);

/* Local vertices of the face opposite local vertex i, ordered so that the normal points outward. */
extern TM_API const int8_t tm_face_vertex[4][3];
/* Local vertices of local edge e: 01 02 03 12 13 23. */
extern TM_API const int8_t tm_edge_vertex[6][2];

/* Quality of one tetrahedron at rest. */
typedef struct tm_tet_quality {
    double volume_m3;
    double aspect; /* longest edge / (2 sqrt(6) inradius): 1 regular, unbounded above */
    double min_dihedral_rad, max_dihedral_rad;
    double min_altitude_m;
} tm_tet_quality;
TM_API tm_tet_quality tm_mesh_tet_quality(const tm_mesh *mesh, int32_t tet);

#ifdef __cplusplus
}
#endif
#endif
