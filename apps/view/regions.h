/* The surface of a mesh that stands still, in the colours of its regions, whole or cut open by a plane. */
#ifndef VIEW_REGIONS_H
#define VIEW_REGIONS_H

#include "picture.h"
#include "tensormass/mesh.h"
#include "tensormass_io.h"

/* How a mesh is shown. */
typedef struct view_cutaway {
    bool clipped;
    double normal[3], offset_m; /* what lies beyond middle + offset along it is taken away */
    double through;             /* of the outer surface's light, 0..1: above 0 regions inside are drawn too */
} view_cutaway;

/* Names and colours: the largest region keeps the look of tissue, the others are told apart by it. */
void view_regions_name(const tm_mesh_file *file, const tm_mesh *mesh, view_picture *picture);
/* Fills the picture's surface. False: no memory. Nothing is left where the plane takes all away: no triangles. */
bool view_regions_surface(const tm_mesh *mesh, const view_cutaway *cut, view_picture *picture);

#endif
