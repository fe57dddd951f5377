/* The renderer, in two modules: lib/tensormass/osmesa.so draws in memory, without display or graphics card; opengl.so
 * draws by the display's OpenGL. */
#ifndef VIEW_RENDER_H
#define VIEW_RENDER_H

#include "camera.h"
#include "picture.h"
#include "tensormass/base.h"

typedef struct view_render_def {
    int width, height; /* pixels, 16..8192 */
    int samples;       /* n*n drawn pixels are averaged into one: 1, 2 or 3 */
    bool edges;        /* smooth edges, at half the speed */
    int levels;        /* subdivision levels of view_skin */
    float crease_rad;
} view_render_def;

typedef struct view_renderer view_renderer;

/* Functions of the module, reached through its single symbol VIEW_RENDER_SYMBOL. */
typedef struct view_render_api {
    tm_status (*create)(const view_render_def *def, view_renderer **renderer, tm_error *error);
    void (*destroy)(view_renderer *renderer);
    /* Draws into rgb[3*width*height], top row first. Call from one thread at a time. */
    tm_status (*draw)(view_renderer *renderer, const view_picture *picture, const view_camera *camera, uint8_t *rgb,
                      tm_error *error);
    /* Returns OpenGL's name of the renderer. */
    const char *(*name)(view_renderer *renderer);
} view_render_api;
#define VIEW_RENDER_SYMBOL "view_render_functions"

#endif
