/* In which order a mesh's vertices and tetrahedra are best numbered: neighbours near each other, so that what a force
 * pass touches is still in the cache, and few edges cross the border between two threads. */
#ifndef TM_NUMBERING_H
#define TM_NUMBERING_H

#include "tensormass/mesh.h"

/* The order of Cuthill and McKee (1969), reversed. It follows from places and edges alone, not from the numbers that
 * were there, as long as no two vertices lie in one place. `was` [vertex_count]: the old number of each new vertex.
 * False: no memory, `was` undefined. */
bool app_numbering(const tm_mesh *mesh, int32_t *was);
/* The tetrahedra after it: ascending by their lowest vertex, then by the next ones. `was_tet` [tet_count]: the old
 * number of each. False: no memory. */
bool app_numbering_tets(const tm_mesh *mesh, const int32_t *was, int32_t *was_tet);

typedef struct app_numbering_figures {
    double distance, renumbered; /* mean of |k - l| over the edges (k,l): as it is, and in the order of app_numbering */
    bool poor;                   /* renumbering is worth it */
} app_numbering_figures;
/* False: no memory. */
bool app_numbering_measure(const tm_mesh *mesh, app_numbering_figures *out);

#endif
