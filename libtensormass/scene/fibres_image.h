/* Fibres from an image of directions, such as the principal direction of diffusion. */
#ifndef TM_SIM_FIBRES_IMAGE_H
#define TM_SIM_FIBRES_IMAGE_H

#include "host.h"

enum { SIM_FIBRES_WHY = 700 };

/* Axes of the image's three numbers. */
typedef enum sim_fibre_axes { SIM_FIBRES_IMAGE, SIM_FIBRES_LPS, SIM_FIBRES_RAS } sim_fibre_axes;

/* Sets fibre[3*tet_count] to unit vectors; m->rest_m is in LPS, m. At a tetrahedron's centroid the eight surrounding
 * voxels are averaged with trilinear weights. Each voxel is first flipped to agree with the nearest one; zero voxels
 * are skipped. Returns false, with one line in `why`, if the module or image is missing or a tetrahedron has no vector
 * near it. */
bool sim_fibres_from_image(const app_host *host, const tm_mesh *m, const char *path, sim_fibre_axes axes, double *fibre,
                           char why[SIM_FIBRES_WHY]);

#endif
