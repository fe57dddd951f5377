/* OpenGL context of OSMesa: draws into memory. */
#include "context.h"

#include <GL/osmesa.h>
#include <stdio.h>
#include <stdlib.h>

struct view_context {
    OSMesaContext own;
    uint8_t *pixels;
    int width, height;
};

const bool view_context_in_memory = true;

view_context *view_context_open(int width, int height, uint8_t *pixels, tm_error *error) {
    static const int attributes[] = {OSMESA_FORMAT,
                                     OSMESA_RGBA,
                                     OSMESA_DEPTH_BITS,
                                     24,
                                     OSMESA_PROFILE,
                                     OSMESA_CORE_PROFILE,
                                     OSMESA_CONTEXT_MAJOR_VERSION,
                                     3,
                                     OSMESA_CONTEXT_MINOR_VERSION,
                                     3,
                                     0};
    view_context *c = calloc(1, sizeof *c);
    if (c) *c = (view_context){OSMesaCreateContextAttribs(attributes, NULL), pixels, width, height};
    if (c && c->own && view_context_use(c)) return c;
    view_context_close(c);
    error->status = TM_ERR_LIMIT, error->entity = -1;
    snprintf(error->message, sizeof error->message,
             "OSMesa gives no OpenGL 3.3 drawing of this size; choose a smaller --size, or install libosmesa6 22.3 or "
             "later");
    return NULL;
}

void view_context_close(view_context *c) {
    if (c && c->own) OSMesaDestroyContext(c->own); /* frees all OpenGL objects of the context */
    free(c);
}

bool view_context_use(view_context *c) {
    return OSMesaMakeCurrent(c->own, c->pixels, GL_UNSIGNED_BYTE, c->width, c->height);
}
