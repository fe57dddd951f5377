/* A closed surface of triangles and the signed distance to it. */
#ifndef MESH_SHELL_H
#define MESH_SHELL_H

#include "mesh_builder.h"
#include "tensormass/base.h"

typedef struct shell shell;

/* Takes `corner_m` [9*triangles], malloced. `closed`: rejects an open surface, and reverses the triangles if normals
 * point inward. Otherwise only shell_distance_m and shell_pieces are valid. */
tm_status shell_of_triangles(double *corner_m, int triangles, bool closed, shell **out, tm_error *error);
double shell_distance_m(const shell *s, const double p[3]);
void shell_free(shell *s);
int shell_triangles(const shell *s);
double shell_volume_m3(const shell *s);
/* Returns whether the triangles were reversed. */
bool shell_turned(const shell *s);
const double *shell_corner_m(const shell *s, int triangle, int corner);
const double *shell_normal(const shell *s, int triangle);
/* Fills the piece, from 0, of each triangle; pieces are connected through vertices. Returns their number, -1 if memory
 * is exhausted. */
int shell_pieces(const shell *s, int *piece);
/* Returns whether p is inside a closed surface; fast if no triangle is near. Not thread-safe. */
bool shell_contains(const shell *s, const double p[3]);
/* Returns the squared distance to the bounding box, a lower bound of that to the surface. */
double shell_box_m2(const shell *s, const double p[3]);
/* Finds the nearest point and its squared distance, if below `*square`; otherwise changes neither. */
void shell_nearer(const shell *s, const double p[3], double *square, double place[3]);
/* Returns the surface as a body, valid while the shell exists. */
growing_solid shell_solid(const shell *s);

/* Reads the triangles' corners. The array is malloced, also on failure. */
tm_status shell_read_stl(const char *path, double scale, double **corner_m, int *triangles, tm_error *error);

#endif
