/* Instruments, arrows and marks as triangles. */
#ifndef VIEW_SHAPES_H
#define VIEW_SHAPES_H

#include "camera.h"
#include "marks.h"
#include "surface_smoothing.h"

/* Values of view_vertex.kind above the tissue's. */
enum {
    VIEW_PAINT_STEEL = 2,
    VIEW_PAINT_SLEEVE = 3,
    VIEW_PAINT_HOT = 4,
    VIEW_PAINT_PORT = 5,
    VIEW_PAINT_ARROW_0 = 6,
    VIEW_PAINT_ARROW_1 = 7,
    VIEW_PAINT_SUPPORT = 8,
    VIEW_PAINT_FIBRE = 9,
    VIEW_PAINT_TIE = 10
};

typedef struct view_shape {
    view_vertex *vertex;
    int32_t count, capacity;
} view_shape; /* three vertices per triangle */

void view_shape_free(view_shape *shape);
/* Each function appends to the shape; if memory is exhausted it appends less. The port is the sleeve in the abdominal
 * wall. */
void view_shape_instrument(view_shape *shape, const view_instrument *instrument);
void view_shape_port(view_shape *shape, const view_instrument *instrument);
/* Appends an arrow. A force along the line of sight would appear as a disc. It is drawn as a ring facing the eye, with
 * a dot (arrow's point) or a cross (its feathers). */
void view_shape_arrow(view_shape *shape, const double from_m[3], const double along_m[3], float thickness_m, int paint,
                      const view_camera *camera);
void view_shape_supports(view_shape *shape, const view_marks *marks, const view_surface *surface, float radius_m);
/* Appends fibre directions on each triangle that is a face of a tetrahedron; they move with the tissue. */
void view_shape_fibres(view_shape *shape, const view_marks *marks, const view_surface *surface);
void view_shape_ties(view_shape *shape, const view_ties *ties, float radius_m);
/* Appends a strand, thicker at its ends. */
void view_shape_strand(view_shape *shape, const float from_m[3], const float to_m[3], float radius_m, int paint);
/* Appends one corner of a triangle, in world coordinates. */
void view_shape_point(view_shape *shape, const float at_m[3], const float normal[3], int paint);

#endif
