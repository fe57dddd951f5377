/* A tetrahedral mesh that grows and moves, for tm-mesh and the generator of meshes/. Lengths in m. If memory is
 * exhausted, `no_memory` is set and later calls do nothing: check it at the end. */
#ifndef GROWING_H
#define GROWING_H

#include <stdbool.h>

enum { MAX_NAMES = 12 };

typedef struct growing {
    int vertex_count, tet_count, vertex_capacity, tet_capacity;
    double *vertex; /* [3*vertex_count] m */
    int *tet;       /* [4*tet_count] positive orientation */
    int *region;    /* [tet_count] index into region_name */
    double *fibre;  /* [3*tet_count] unit, or null */
    int face_count;
    int *face;       /* [3*face_count] outer triangles, normals outward */
    int *face_group; /* [face_count] index into face_name */
    int region_names, face_names;
    const char *region_name[MAX_NAMES], *face_name[MAX_NAMES];
    bool no_memory;
} growing;

/* Adds a vertex; returns -1 if memory is exhausted. */
int growing_add_vertex(growing *m, const double p[3]);
/* Adds a tetrahedron in positive orientation. Does nothing if a corner is -1. */
void growing_add_tet(growing *m, int a, int b, int c, int d);
void growing_free(growing *m);
/* Fills `face` from the tetrahedra: each outer face once, ascending. Returns false if the faces are not a closed
 * manifold. */
bool growing_find_surface(growing *m);

/* Computes the unit normal of the triangle. */
void growing_face_normal(const growing *m, const int face[3], double n[3]);
/* Returns 1/sqrt(sum 1/h_k^2) of the four altitudes, m, which determines the critical step. Negative if inverted. */
double growing_tet_size(const double *a, const double *b, const double *c, const double *d);

/* A closed body. */
typedef struct growing_solid {
    double (*inside)(const void *shape, const double p[3]); /* > 0 inside, approximately the distance to the surface */
    void (*project)(const void *shape, double p[3]);        /* moves p to the surface nearby */
    const void *shape;
    double low[3], high[3];
} growing_solid;

/* Fills the body with the tetrahedra of a body-centred cubic lattice of cell size `a`, trimmed at the surface and moved
 * onto it. */
void growing_fill(growing *m, const growing_solid *b, double a);

/* Returns whether a tetrahedron is too large for its position. */
typedef bool growing_wanted_fn(const growing *m, int tet, double longest_m, const void *context);

/* Bisects longest edges (Rivara) around every tetrahedron that `wanted` selects, until none is selected. parent[t]:
 * original tetrahedron of t. midpoint[2*(v - first new vertex)]: ends of the edge that new vertex v halves. Both
 * malloced here. */
bool growing_bisect(growing *m, growing_wanted_fn *wanted, const void *context, int limit, int **parent,
                    int **midpoint);
double growing_longest_edge_m(const growing *m, int tet);

/* Tetrahedra around each vertex: tet[begin[v]] to before begin[v + 1], ascending. False: memory is exhausted (free it
 * also then). */
typedef struct growing_fans {
    int *begin, *tet;
} growing_fans;
bool growing_fans_make(const growing *m, growing_fans *out);
void growing_fans_free(growing_fans *f);

/* How a vertex may move: not at all, along `direction`, perpendicular to it, freely. */
typedef enum freedom { FIXED, ALONG, ACROSS, FREE } freedom;
typedef struct growing_hold {
    unsigned char *freedom;    /* [vertex_count] */
    double *direction;         /* [3*vertex_count] unit */
    growing_wanted_fn *wanted; /* selects tetrahedra that must not arise */
    const void *context;
    bool (*settle)(const void *shape, int v, double p[3]); /* null, or: corrects vertex v's new position; returns false
                                                            * if no valid position is near */
    const void *shape;
} growing_hold;

/* Moves vertices to enlarge the smallest tet_size. With `b`, vertices of `face` stay on the body's surface; with `h`,
 * each keeps its freedom. Either may be null. */
void growing_improve(growing *m, const growing_solid *b, const growing_hold *h, int sweeps);

#endif
