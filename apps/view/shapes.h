/* Instruments and arrows as triangles. */
#ifndef VIEW_SHAPES_H
#define VIEW_SHAPES_H

#include "skin.h"

/* Values of view_vertex.kind past the tissue's own. */
enum {
    VIEW_PAINT_STEEL = 2,
    VIEW_PAINT_SLEEVE = 3,
    VIEW_PAINT_HOT = 4,
    VIEW_PAINT_PORT = 5,
    VIEW_PAINT_ARROW_0 = 6,
    VIEW_PAINT_ARROW_1 = 7
};

typedef struct view_shape {
    view_vertex *vertex;
    int32_t count, capacity;
} view_shape; /* three vertices a triangle */

void view_shape_free(view_shape *shape);
/* All add to the shape; where memory runs out they add less. The port is the sleeve in the body's wall. */
void view_shape_instrument(view_shape *shape, const view_instrument *instrument);
void view_shape_port(view_shape *shape, const view_instrument *instrument);
void view_shape_arrow(view_shape *shape, const double from_m[3], const double along_m[3], float thickness_m, int paint);

#endif
