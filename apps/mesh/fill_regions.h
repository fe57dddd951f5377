/* Several closed surfaces, next to or inside each other, as regions of one mesh. */
#ifndef MESH_FILL_REGIONS_H
#define MESH_FILL_REGIONS_H

#include "surfaces.h"

/* Tetrahedra of edges about `size_m`, conformal between regions; says what came of each. Exit code. */
int fill_regions(const char *path, const surfaces *s, double size_m, tm_mesh_file *out);

#endif
