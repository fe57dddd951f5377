/* A closed surface of triangles, and how far a point is from it. */
#ifndef MESH_SHELL_H
#define MESH_SHELL_H

#include "mesh_builder.h"
#include "tensormass/base.h"

typedef struct shell shell;

/* Takes `corner_m` [9*triangles], malloced. `closed`: refuses what is not, and turns it inside in if its normals point
 * inwards; else it is for shell_distance_m and shell_pieces alone. */
tm_status shell_of_triangles(double *corner_m, int triangles, bool closed, shell **out, tm_error *error);
double shell_distance_m(const shell *s, const double p[3]);
void shell_free(shell *s);
int shell_triangles(const shell *s);
double shell_volume_m3(const shell *s);
/* Whether its triangles came inside out. */
bool shell_turned(const shell *s);
const double *shell_corner_m(const shell *s, int triangle, int corner);
const double *shell_normal(const shell *s, int triangle);
/* The piece, from 0, that each triangle is in: what hangs together through vertices. How many; -1: no memory. */
int shell_pieces(const shell *s, int *piece);
/* Of a closed one; quick where no triangle is near. Not for several threads at once. */
bool shell_contains(const shell *s, const double p[3]);
/* Square of the distance to the box around it, at most that to itself. */
double shell_box_m2(const shell *s, const double p[3]);
/* The nearest place, and the square of how far it is, where that is less than `*square`; else both stay. */
void shell_nearer(const shell *s, const double p[3], double *square, double place[3]);
/* The shell as a body. Valid while the shell lives. */
growing_solid shell_solid(const shell *s);

/* Corners of the triangles, malloced here also on failure. */
tm_status shell_read_stl(const char *path, double scale, double **corner_m, int *triangles, tm_error *error);

#endif
