/* A tetrahedral mesh that grows and moves: what the generator of meshes/ and tm-mesh build with. Lengths in m. Where
 * memory is out `no_memory` is set, and all that follows does nothing: look at it at the end. */
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

/* -1: no memory. */
int growing_add_vertex(growing *m, const double p[3]);
/* Turns it to positive orientation. Nothing happens where a corner is -1. */
void growing_add_tet(growing *m, int a, int b, int c, int d);
void growing_free(growing *m);
/* Fills `face` from the tetrahedra: each outer face once, ascending. False if they are not a closed manifold. */
bool growing_find_surface(growing *m);

/* Unit normal of the triangle. */
void growing_face_normal(const growing *m, const int face[3], double n[3]);
/* 1/sqrt(sum 1/h_k^2) of the four altitudes, m: what the critical step is made of. Negative for an inverted one. */
double growing_tet_size(const double *a, const double *b, const double *c, const double *d);

/* A closed body. */
typedef struct growing_solid {
    double (*inside)(const void *shape, const double p[3]); /* > 0 inside, about as far as the surface is */
    void (*project)(const void *shape, double p[3]);        /* onto the surface nearby */
    const void *shape;
    double low[3], high[3];
} growing_solid;

/* Fills the body with the tetrahedra of a body-centred cubic lattice of cell `a`, cut and pulled to the surface. */
void growing_fill(growing *m, const growing_solid *b, double a);

/* Whether a tetrahedron is too large where it is. */
typedef bool growing_wanted_fn(const growing *m, int tet, double longest_m, const void *context);

/* Halves longest edges (Rivara) around every tetrahedron that is wanted smaller, until none is. parent[t] is the
 * tetrahedron of the start that t came from; midpoint[2*(v - first new vertex)] are the ends of the edge that new
 * vertex v halved. Both malloced here. */
bool growing_bisect(growing *m, growing_wanted_fn *wanted, const void *context, int limit, int **parent,
                    int **midpoint);
double growing_longest_edge_m(const growing *m, int tet);

/* Tetrahedra around each vertex: tet[begin[v]] to before begin[v + 1], ascending. False: no memory (free it then, too).
 */
typedef struct growing_fans {
    int *begin, *tet;
} growing_fans;
bool growing_fans_make(const growing *m, growing_fans *out);
void growing_fans_free(growing_fans *f);

/* How far a vertex may move: not at all, along `direction`, across it (in the plane that it is the normal of),
 * anywhere. */
typedef enum freedom { FIXED, ALONG, ACROSS, FREE } freedom;
typedef struct growing_hold {
    unsigned char *freedom;    /* [vertex_count] */
    double *direction;         /* [3*vertex_count] unit */
    growing_wanted_fn *wanted; /* no tetrahedron becomes one of these */
    const void *context;
    bool (*settle)(const void *shape, int v, double p[3]); /* null, or: puts vertex v's new place where it belongs;
                                                            * false: nothing near belongs to it */
    const void *shape;
} growing_hold;

/* Moves vertices so that the smallest tet_size grows. Where the body is given, vertices of `face` stay on its surface;
 * where `h` is, each keeps to it. Either may be null. */
void growing_improve(growing *m, const growing_solid *b, const growing_hold *h, int sweeps);

#endif
