/* Where words may stand on the picture: labels keep off panels and off each other. */
#ifndef VIEW_LAYOUT_H
#define VIEW_LAYOUT_H

#include <stdbool.h>

enum { VIEW_LAYOUT_MAX = 8 };

typedef struct view_layout {
    int count;
    float box[VIEW_LAYOUT_MAX][4]; /* left, top, right, bottom; pixels */
} view_layout;

/* A box that is taken from now on; left out when there are too many. */
void view_layout_take(view_layout *layout, float x0, float y0, float x1, float y1);
bool view_layout_taken(const view_layout *layout, const float box[4]);
/* Moves a box by the shortest way to where nothing is: beside, above or below of what is there, within the picture. It
 * stays if there is no such place. */
void view_layout_find_space(const view_layout *layout, float width, float height, float gap, float box[4]);

#endif
