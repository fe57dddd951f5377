/* Internals of the renderer: creation (render_make.c), lights and passes of a picture (render.c). */
#ifndef VIEW_RENDER_PARTS_H
#define VIEW_RENDER_PARTS_H

#define GL_GLEXT_PROTOTYPES
#include <GL/gl.h>
#include <GL/glext.h>

#include "context.h"
#include "render.h"
#include "shapes.h"
#include "surface_smoothing.h"

enum { VIEW_SHADOW_PX = 1024, VIEW_SPOT_PX = 128 };

typedef struct view_batch {
    GLuint array, vertices, indices, coarse_indices;
    GLsizei count, coarse_count, inside_count; /* inside_count: the first of count, inner faces */
} view_batch;

struct view_renderer {
    view_render_def def;
    view_context *context;
    int width, height; /* size of the drawing: samples times the picture's */
    uint8_t *buffer;   /* [4*width*height] bottom row first */
    GLuint depth_program, blur_program, sky_program, floor_program, tissue_program, metal_program;
    GLuint shadow_texture, shadow_target, spot_texture[3], spot_target[3], picture_target, picture_buffer[2], empty;
    GLuint whole_target, whole_buffer; /* samples averaged; 0: the context writes to memory */
    view_batch tissue, tools, arrows, marks;
    view_skin *skin;
    view_shape tool_shape, arrow_shape, mark_shape;
    int32_t support_count; /* vertices of mark_shape that mark supports; those of fibres and ties follow */
    int32_t shadow_count;  /* vertices of tool_shape that cast shadows */
};

/* Values shared by one picture's passes. */
typedef struct view_light {
    float to_clip[16], to_light[16], key[3], fill[3], up[3], across[3], along[3], middle[3];
    float eye[3], radius, spot_size;
} view_light;

tm_status view_renderer_create(const view_render_def *def, view_renderer **out, tm_error *error);
void view_renderer_destroy(view_renderer *r);
tm_status view_render_failed(tm_error *error, tm_status status, const char *what);

#endif
