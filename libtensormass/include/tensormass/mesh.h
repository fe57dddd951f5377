/* Tetrahedral mesh: rest positions and topology. Built once, then const: cutting marks tetrahedra in the tissue,
 * the mesh keeps its numbering for ever. */
#ifndef TENSORMASS_MESH_H
#define TENSORMASS_MESH_H

#include "base.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_MAX_REGIONS 1048576

typedef struct tm_mesh_def {
    uint32_t cookie, size; /* both set by tm_mesh_def_default */
    int32_t vertex_count;
    const double *vertex_m; /* [3*vertex_count] rest positions, m */
    int32_t tet_count;
    const int32_t *tet;    /* [4*tet_count] vertex indices, positive orientation: (p1-p0)x(p2-p0).(p3-p0) > 0 */
    const int32_t *region; /* [tet_count] region of each tetrahedron, 0 to TM_MAX_REGIONS - 1, or null: all 0 */
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
} tm_mesh;

TM_API tm_mesh_def tm_mesh_def_default(void);

/* Validates, then builds. Refuses (TM_ERR_MESH, `entity` names it): indices out of range, a vertex twice in one
 * tetrahedron, coordinates not finite, zero or negative volume, a tetrahedron twice, a face shared by three, a vertex
 * without tetrahedra, an empty mesh. `*mesh` is untouched on failure. */
TM_API tm_status tm_mesh_create(const tm_mesh_def *def, tm_mesh **mesh, tm_error *error);
TM_API void tm_mesh_destroy(tm_mesh *mesh);

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
