/* Closed surfaces from files: in pieces, inside each other, as regions. */
#ifndef MESH_SURFACES_H
#define MESH_SURFACES_H

#include "command.h"
#include "image_api.h"
#include "signed_distance.h"

enum { SURFACES_MAX = 255, SURFACES_FILES = 32 };

/* One closed piece. */
typedef struct surface_piece {
    shell *shell;
    int file, parent; /* the smallest piece around it, -1: none */
    bool cavity;      /* of its parent: the same file's, turned the other way */
    int region;       /* from 1; 0: a cavity */
} surface_piece;

typedef struct surfaces {
    int pieces;
    surface_piece piece[SURFACES_MAX]; /* smallest volume first */
    int regions;
    char name[SURFACES_MAX + 1][64]; /* from 1 */
    shell *whole;                    /* all triangles, where they are one region; else null */
} surfaces;

/* Reads the files (STL here, others by the module `image`), times `scale`; says what is wrong with each, and repairs it
 * where that is asked for. Exit code. */
int surfaces_load(char *const *path, int files, double scale, bool repair, surfaces *out);
void surfaces_free(surfaces *s);
/* image_label_fn: the smallest region that `p` is in, 0 outside. */
int surfaces_label(const void *surfaces, const double p[3]);
/* Onto the nearest of them. */
void surfaces_project(const void *surfaces, double p[3]);

/* --- several closed surfaces, next to or inside each other, as regions of one mesh --- */

/* Tetrahedra of edges about `size_m`, conformal between regions; says what came of each. Exit code. */
int fill_regions(const char *path, const surfaces *s, double size_m, tm_mesh_file *out);

#endif
