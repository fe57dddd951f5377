/* Where render.c draws: an OpenGL 3.3 core context, of OSMesa (in memory, module osmesa.so) or of the display (module
 * opengl.so). */
#ifndef VIEW_CONTEXT_H
#define VIEW_CONTEXT_H

#include <stdbool.h>
#include <stdint.h>

#include "tensormass/base.h"

typedef struct view_context view_context;

/* True: framebuffer 0 is the memory handed to view_context_open. False: it is nobody's; what is drawn has to be read
 * back. */
extern const bool view_context_in_memory;

/* pixels[4*width*height] RGBA, bottom row first, used as long as the context lives. Null with `error` where there is no
 * such context. */
view_context *view_context_open(int width, int height, uint8_t *pixels, tm_error *error);
void view_context_close(view_context *context);
/* To be called before every picture: others may draw in the same thread. */
bool view_context_use(view_context *context);

#endif
