/* A tetrahedral mesh that grows and moves: what the generator of meshes/ and tm-mesh build with. Lengths in m. */
#ifndef GROWING_H
#define GROWING_H

#include <stdbool.h>

enum { MAX_NAMES = 12 };

typedef struct mesh {
    int vertex_count, tet_count, vertex_room, tet_room;
    double *vertex;        /* [3*vertex_count] m */
    int *tet;              /* [4*tet_count] positive orientation */
    int *region;           /* [tet_count] index into region_name */
    double *fibre;         /* [3*tet_count] unit, or null */
    int face_count;
    int *face;             /* [3*face_count] outer triangles, normals outward */
    int *face_group;       /* [face_count] index into face_name */
    int region_names, face_names;
    const char *region_name[MAX_NAMES], *face_name[MAX_NAMES];
} mesh;

int add_vertex(mesh *m, const double p[3]);
/* Turns it to positive orientation. */
void add_tet(mesh *m, int a, int b, int c, int d);
void free_mesh(mesh *m);
/* Fills `face` from the tetrahedra: each outer face once, ascending. False if they are not a closed manifold. */
bool find_surface(mesh *m);

/* 1/sqrt(sum 1/h_k^2) of the four altitudes, m: what the critical step is made of. Negative for an inverted one. */
double tet_size(const double *a, const double *b, const double *c, const double *d);

/* A body where inside(p) > 0, growing about as fast as the distance to its surface. */
typedef double inside_fn(const double p[3]);

/* Fills the body with the tetrahedra of a body-centred cubic lattice of cell `a`, cut and pulled to the surface. */
void fill_body(mesh *m, inside_fn *inside, const double low[3], const double high[3], double a);
/* Moves vertices until the smallest tet_size no longer grows; those of the surface stay on it (inside null: they stay
 * where they are), those with a mark in `fixed` (or null) stay. */
void improve(mesh *m, inside_fn *inside, const unsigned char *fixed, int sweeps);

/* Halves longest edges (Rivara) around every tetrahedron that `wanted` says is too large, until none is. parent[t] is the tetrahedron of
 * the start that t came from; midpoint[2*(v - first new vertex)] are the ends of the edge that new vertex v halved. Both malloced here. */
typedef bool wanted_fn(const mesh *m, int tet, double longest_m, const void *context);
bool bisect(mesh *m, wanted_fn *wanted, const void *context, int limit, int **parent, int **midpoint);

#endif
