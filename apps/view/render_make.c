/* Creates and destroys the renderer: context, programs and targets. */
#include <stdio.h>
#include <stdlib.h>

#include "render_parts.h"
#include "shaders.h"

tm_status view_render_failed(tm_error *error, tm_status status, const char *what) {
    if (error) {
        error->status = status, error->entity = -1;
        snprintf(error->message, sizeof error->message, "%s", what);
    }
    return status;
}

static GLuint shader(GLenum type, const char *text) {
    GLuint id = glCreateShader(type);
    glShaderSource(id, 1, &text, NULL);
    glCompileShader(id);
    return id;
}

static GLuint link_program(const char *vertex, const char *fragment, tm_error *error) {
    GLuint v = shader(GL_VERTEX_SHADER, vertex), f = shader(GL_FRAGMENT_SHADER, fragment), id = glCreateProgram();
    glAttachShader(id, v);
    glAttachShader(id, f);
    glLinkProgram(id);
    glDeleteShader(v);
    glDeleteShader(f);
    GLint good = 0;
    glGetProgramiv(id, GL_LINK_STATUS, &good);
    if (good) return id;
    char log[400] = "";
    glGetProgramInfoLog(id, sizeof log, NULL, log);
    char text[TM_ERROR_MESSAGE_MAX];
    snprintf(text, sizeof text, "this OpenGL rejects the renderer's shaders (%s); install libosmesa6 22.3 or later",
             log);
    view_render_failed(error, TM_ERR_LIMIT, text);
    glDeleteProgram(id);
    return 0;
}

static void batch_create(view_batch *b) {
    glGenVertexArrays(1, &b->array);
    glGenBuffers(1, &b->vertices);
    glGenBuffers(1, &b->indices);
    glGenBuffers(1, &b->coarse_indices);
    glBindVertexArray(b->array);
    glBindBuffer(GL_ARRAY_BUFFER, b->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, b->indices);
    static const struct {
        GLint size;
        size_t offset;
    } field[5] = {{3, offsetof(view_vertex, at_m)},
                  {3, offsetof(view_vertex, normal)},
                  {3, offsetof(view_vertex, reference_m)},
                  {2, offsetof(view_vertex, kind)},
                  {2, offsetof(view_vertex, mottle)}};
    for (GLuint i = 0; i < 5; i++) {
        glEnableVertexAttribArray(i);
        glVertexAttribPointer(i, field[i].size, GL_FLOAT, GL_FALSE, sizeof(view_vertex), (const void *)field[i].offset);
    }
    glBindVertexArray(0);
}

static GLuint target_of(GLuint texture, GLenum attachment) {
    GLuint id;
    glGenFramebuffers(1, &id);
    glBindFramebuffer(GL_FRAMEBUFFER, id);
    glFramebufferTexture2D(GL_FRAMEBUFFER, attachment, GL_TEXTURE_2D, texture, 0);
    if (attachment == GL_DEPTH_ATTACHMENT) glDrawBuffer(GL_NONE), glReadBuffer(GL_NONE);
    return id;
}

static void texture_sampling(GLint filter) {
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, filter);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, filter);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

static void targets_create(view_renderer *r) {
    glGenTextures(1, &r->shadow_texture);
    glBindTexture(GL_TEXTURE_2D, r->shadow_texture);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_DEPTH_COMPONENT24, VIEW_SHADOW_PX, VIEW_SHADOW_PX, 0, GL_DEPTH_COMPONENT,
                 GL_UNSIGNED_INT, NULL);
    texture_sampling(GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
    r->shadow_target = target_of(r->shadow_texture, GL_DEPTH_ATTACHMENT);
    glGenTextures(3, r->spot_texture);
    for (int i = 0; i < 3; i++) {
        glBindTexture(GL_TEXTURE_2D, r->spot_texture[i]);
        glTexImage2D(GL_TEXTURE_2D, 0, GL_R8, VIEW_SPOT_PX, VIEW_SPOT_PX, 0, GL_RED, GL_UNSIGNED_BYTE, NULL);
        texture_sampling(GL_LINEAR);
        r->spot_target[i] = target_of(r->spot_texture[i], GL_COLOR_ATTACHMENT0);
    }
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glGenVertexArrays(1, &r->empty);
}

/* Four coverage samples per pixel smooth the edges; shading still runs once per pixel. */
static bool picture_target_create(view_renderer *r) {
    static const GLenum format[2] = {GL_RGBA8, GL_DEPTH_COMPONENT24},
                        attachment[2] = {GL_COLOR_ATTACHMENT0, GL_DEPTH_ATTACHMENT};
    glGenFramebuffers(1, &r->picture_target);
    glBindFramebuffer(GL_FRAMEBUFFER, r->picture_target);
    glGenRenderbuffers(2, r->picture_buffer);
    for (int i = 0; i < 2; i++) {
        glBindRenderbuffer(GL_RENDERBUFFER, r->picture_buffer[i]);
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, r->def.edges ? 4 : 0, format[i], r->width, r->height);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment[i], GL_RENDERBUFFER, r->picture_buffer[i]);
    }
    bool good = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    if (view_context_in_memory) return good;
    glGenFramebuffers(1, &r->whole_target);
    glGenRenderbuffers(1, &r->whole_buffer);
    glBindFramebuffer(GL_FRAMEBUFFER, r->whole_target);
    glBindRenderbuffer(GL_RENDERBUFFER, r->whole_buffer);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, r->width, r->height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, r->whole_buffer);
    return good && glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

void view_renderer_destroy(view_renderer *r) {
    if (!r) return;
    view_context_close(r->context);
    view_skin_free(r->skin);
    view_shape_free(&r->tool_shape);
    view_shape_free(&r->arrow_shape);
    view_shape_free(&r->mark_shape);
    free(r->buffer);
    free(r);
}

static tm_status programs_create(view_renderer *r, tm_error *error) {
    const struct {
        GLuint *id;
        const char *vertex, *fragment;
    } table[] = {
        {&r->depth_program, view_depth_vertex, view_depth_fragment},
        {&r->blur_program, view_blur_vertex, view_blur_fragment},
        {&r->sky_program, view_blur_vertex, view_sky_fragment},
        {&r->floor_program, view_floor_vertex, view_floor_fragment},
        {&r->tissue_program, view_lit_vertex, view_tissue_fragment},
        {&r->metal_program, view_lit_vertex, view_metal_fragment},
    };
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (!(*table[i].id = link_program(table[i].vertex, table[i].fragment, error))) return TM_ERR_LIMIT;
    return TM_OK;
}

tm_status view_renderer_create(const view_render_def *def, view_renderer **out, tm_error *error) {
    if (def->width < 16 || def->width > 8192 || def->height < 16 || def->height > 8192 || def->samples < 1 ||
        def->samples > 3)
        return view_render_failed(
            error, TM_ERR_ARGUMENT,
            "the picture's size is out of range; choose a --size of 16 to 8192 pixels with 1 to 3 samples");
    view_renderer *r = calloc(1, sizeof *r);
    if (!r) return view_render_failed(error, TM_ERR_MEMORY, "no memory for the renderer; choose a smaller --size");
    r->def = *def;
    r->width = def->width * def->samples, r->height = def->height * def->samples;
    r->buffer = malloc((size_t)r->width * (size_t)r->height * 4);
    r->skin = view_skin_create(def->levels, def->crease_rad);
    if (!r->buffer || !r->skin) {
        view_renderer_destroy(r);
        return view_render_failed(error, TM_ERR_MEMORY, "no memory for the renderer; choose a smaller --size");
    }
    r->context = view_context_open(r->width, r->height, r->buffer, error);
    if (!r->context) return view_renderer_destroy(r), TM_ERR_LIMIT;
    tm_status status = programs_create(r, error);
    if (status) return view_renderer_destroy(r), status;
    batch_create(&r->tissue);
    batch_create(&r->tools);
    batch_create(&r->arrows);
    batch_create(&r->marks);
    targets_create(r);
    if (!picture_target_create(r)) {
        view_renderer_destroy(r);
        return view_render_failed(error, TM_ERR_LIMIT,
                                  "OpenGL cannot draw smooth edges; install libosmesa6 22.3 or later");
    }
    *out = r;
    return TM_OK;
}
