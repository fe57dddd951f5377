/* The critical step of a mesh, and the cost of stepping it on this machine. */
#ifndef MESH_STEP_H
#define MESH_STEP_H

#include "image_api.h"
#include "tensormass/tissue.h"

typedef struct step_figures {
    double guaranteed_s, cut_s, median_s; /* guaranteed; guaranteed with cutting (worst element); median of elements */
    int32_t tet, cut_tet;                 /* tetrahedra that set the first two */
} step_figures;

/* Computes critical steps with one material everywhere. */
tm_status step_measure(const tm_mesh *mesh, double young_Pa, double poisson, double density_kg_m3, step_figures *out,
                       tm_error *error);
/* Measures core seconds per simulated second on this machine, by stepping a world of this mesh for a tenth of a second.
 * Returns the exit code. */
int step_load(const char *file, const image_tets *tets, double young_Pa, double poisson, double density_kg_m3,
              double *load);

#endif
