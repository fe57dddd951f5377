/* Text on the picture: a stroke font of this project's own, drawn with soft edges at any height. */
#ifndef VIEW_FONT_H
#define VIEW_FONT_H

#include <stdint.h>

typedef struct view_canvas {
    int width, height;
    uint8_t *rgb; /* [3*width*height], top row first */
} view_canvas;
typedef struct view_colour {
    uint8_t r, g, b;
    float alpha;
} view_colour;

/* Returns the width of `text` in pixels, in capitals `cap_px` high. */
float view_text_width(const char *text, float cap_px);
/* Draws text with left edge `x_px` and baseline `y_px`. Bytes outside printable ASCII are drawn as '?'. */
void view_text(const view_canvas *canvas, float x_px, float y_px, float cap_px, view_colour colour, const char *text);
/* Draws a segment with round ends, `width_px` wide. */
void view_line(const view_canvas *canvas, float x0, float y0, float x1, float y1, float width_px, view_colour colour);
/* Draws a filled box with round corners. */
void view_box(const view_canvas *canvas, float x0, float y0, float x1, float y1, float corner_px, view_colour colour);

#endif
