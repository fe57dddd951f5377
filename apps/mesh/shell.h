/* A closed surface of triangles, from STL, and how far a point is from it. */
#ifndef MESH_SHELL_H
#define MESH_SHELL_H

#include "growing.h"
#include "tensormass/base.h"

typedef struct shell shell;

/* Text or binary STL, times `scale`. Refuses what is no STL, not finite, or not closed; turns it inside in if its
 * normals point inwards. */
tm_status shell_load(const char *path, double scale, shell **out, tm_error *error);
void shell_free(shell *s);
int shell_triangles(const shell *s);
double shell_volume_m3(const shell *s);
/* The shell as a body. Valid while the shell lives. */
growing_solid shell_solid(const shell *s);

/* Corners of the triangles, malloced here also on failure. Private to shell.c. */
tm_status shell_read_stl(const char *path, double scale, double **corner_m, int *triangles, tm_error *error);

#endif
