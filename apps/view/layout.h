/* Placement of labels on the picture: they overlap neither panels nor each other. */
#ifndef VIEW_LAYOUT_H
#define VIEW_LAYOUT_H

#include <stdbool.h>

enum { VIEW_LAYOUT_MAX = 8 };

typedef struct view_layout {
    int count;
    float box[VIEW_LAYOUT_MAX][4]; /* left, top, right, bottom; pixels */
} view_layout;

/* Reserves a box; ignored if there are too many. */
void view_layout_take(view_layout *layout, float x0, float y0, float x1, float y1);
bool view_layout_taken(const view_layout *layout, const float box[4]);
/* Moves a box by the shortest way to free space within the picture, to the side of, above or below other boxes. Leaves
 * it if there is no space. */
void view_layout_find_space(const view_layout *layout, float width, float height, float gap, float box[4]);

#endif
