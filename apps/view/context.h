/* OpenGL 3.3 core context for render.c: OSMesa's in memory (module osmesa.so) or the display's (module opengl.so). */
#ifndef VIEW_CONTEXT_H
#define VIEW_CONTEXT_H

#include <stdbool.h>
#include <stdint.h>

#include "tensormass/base.h"

typedef struct view_context view_context;

/* True: framebuffer 0 is the memory passed to view_context_open. False: the caller must read pictures back. */
extern const bool view_context_in_memory;

/* Opens a context. pixels[4*width*height] RGBA, bottom row first, must outlive it. Returns null with `error` if no such
 * context is available. */
view_context *view_context_open(int width, int height, uint8_t *pixels, tm_error *error);
void view_context_close(view_context *context);
/* Makes the context current. Call it before every picture: other code may draw in the same thread. */
bool view_context_use(view_context *context);

#endif
