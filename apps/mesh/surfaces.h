/* Closed surfaces from files: their pieces, nesting and regions. */
#ifndef MESH_SURFACES_H
#define MESH_SURFACES_H

#include "command.h"
#include "image_api.h"
#include "signed_distance.h"

enum { SURFACES_MAX = 255, SURFACES_FILES = 32 };

/* One closed piece. */
typedef struct surface_piece {
    shell *shell;
    int file, parent; /* parent: smallest piece around it, -1: none */
    bool cavity;      /* cavity of its parent: from the same file, opposite orientation */
    int region;       /* from 1; 0: cavity */
} surface_piece;

typedef struct surfaces {
    int pieces;
    surface_piece piece[SURFACES_MAX]; /* smallest volume first */
    int regions;
    char name[SURFACES_MAX + 1][64]; /* [1..] */
    shell *whole;                    /* all triangles, if they are one region; else null */
} surfaces;

/* Reads the files (STL here, others by the module `image`), times `scale`. Reports the defects of each; repairs them if
 * requested. Returns the exit code. */
int surfaces_load(char *const *path, int files, double scale, bool repair, surfaces *out);
void surfaces_free(surfaces *s);
/* image_label_fn: returns the smallest region around `p`, 0 outside. */
int surfaces_label(const void *surfaces, const double p[3]);
/* Moves p onto the nearest surface. */
void surfaces_project(const void *surfaces, double p[3]);

/* --- several closed surfaces, adjacent or nested, as regions of one mesh --- */

/* Makes tetrahedra of edges about `size_m`, conformal between regions, and reports each region. Returns the exit
 * code. */
int fill_regions(const char *path, const surfaces *s, double size_m, tm_mesh_file *out);

#endif
