/* The time step that a mesh allows, and what stepping it costs here. */
#ifndef MESH_STEP_H
#define MESH_STEP_H

#include "image_api.h"
#include "tensormass/tissue.h"

typedef struct step_figures {
    double guaranteed_s, cut_s, median_s; /* of the whole, where it may be cut (the worst element's), of elements */
    int32_t tet, cut_tet;                 /* that set the first two */
} step_figures;

/* Critical steps of one material everywhere. */
tm_status step_measure(const tm_mesh *mesh, double young_Pa, double poisson, double density_kg_m3, step_figures *out,
                       tm_error *error);
/* Seconds of one core of this machine that a simulated second takes: a world of this mesh, stepped for a tenth of a
 * second. Exit code. */
int step_load(const char *file, const image_tets *tets, double young_Pa, double poisson, double density_kg_m3,
              double *load);

#endif
