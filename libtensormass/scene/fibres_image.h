/* Fibres from an image of directions, such as the principal one of diffusion. */
#ifndef TM_SIM_FIBRES_IMAGE_H
#define TM_SIM_FIBRES_IMAGE_H

#include "host.h"

enum { SIM_FIBRES_WHY = 700 };

/* What the image's three numbers run along. */
typedef enum sim_fibre_axes { SIM_FIBRES_IMAGE, SIM_FIBRES_LPS, SIM_FIBRES_RAS } sim_fibre_axes;

/* fibre[3*tet_count] := unit vectors, m->rest_m in LPS, m. At a tetrahedron's centroid the eight voxels around it count
 * by trilinear weights, each the way round that agrees with the nearest of them; voxels of zeros are left out. False,
 * and one line in `why`: no such module or image, or a tetrahedron that has no vector around it. */
bool sim_fibres_from_image(const app_host *host, const tm_mesh *m, const char *path, sim_fibre_axes axes, double *fibre,
                           char why[SIM_FIBRES_WHY]);

#endif
