#include "render.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/gl.h>
#include <GL/glext.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "context.h"
#include "shaders.h"
#include "shapes.h"
#include "skin.h"

enum { SHADOW_PX = 1024, SPOT_PX = 128 };

typedef struct batch {
    GLuint array, vertices, indices, coarse_indices;
    GLsizei count, coarse_count;
} batch;

struct view_renderer {
    view_render_def def;
    view_context *context;
    int width, height; /* of the drawing: samples times the picture's */
    uint8_t *buffer;   /* [4*width*height] bottom row first */
    GLuint depth_program, blur_program, sky_program, floor_program, tissue_program, metal_program;
    GLuint shadow_texture, shadow_target, spot_texture[3], spot_target[3], picture_target, picture_buffer[2], empty;
    GLuint whole_target, whole_buffer; /* the picture with its samples joined; 0: it goes to memory by itself */
    batch tissue, tools, arrows, marks;
    view_skin *skin;
    view_shape tool_shape, arrow_shape, mark_shape;
    int32_t support_count; /* vertices of mark_shape that mark supports; fibres follow */
    int32_t shadow_count;  /* vertices of tool_shape that throw shadows */
};

/* What one picture's passes share. */
typedef struct scene {
    float to_clip[16], to_light[16], key[3], fill[3], up[3], across[3], along[3], middle[3];
    float eye[3], radius, spot_size;
} scene;

static const float sky_low[3] = {0.052f, 0.062f, 0.070f}, sky_high[3] = {0.20f, 0.235f, 0.26f};

static tm_status failed(tm_error *error, tm_status status, const char *what) {
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
    snprintf(text, sizeof text,
             "this OpenGL does not take the renderer's shaders (%s); install libosmesa6 22.3 or later", log);
    failed(error, TM_ERR_LIMIT, text);
    glDeleteProgram(id);
    return 0;
}

static void batch_create(batch *b) {
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
    glTexImage2D(GL_TEXTURE_2D, 0, GL_DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX, 0, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT,
                 NULL);
    texture_sampling(GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
    r->shadow_target = target_of(r->shadow_texture, GL_DEPTH_ATTACHMENT);
    glGenTextures(3, r->spot_texture);
    for (int i = 0; i < 3; i++) {
        glBindTexture(GL_TEXTURE_2D, r->spot_texture[i]);
        glTexImage2D(GL_TEXTURE_2D, 0, GL_R8, SPOT_PX, SPOT_PX, 0, GL_RED, GL_UNSIGNED_BYTE, NULL);
        texture_sampling(GL_LINEAR);
        r->spot_target[i] = target_of(r->spot_texture[i], GL_COLOR_ATTACHMENT0);
    }
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    glGenVertexArrays(1, &r->empty);
}

/* Four coverage samples a pixel smooth the edges; shading still runs once a pixel. */
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

static void renderer_destroy(view_renderer *r) {
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

static tm_status renderer_create(const view_render_def *def, view_renderer **out, tm_error *error) {
    if (def->width < 16 || def->width > 8192 || def->height < 16 || def->height > 8192 || def->samples < 1 ||
        def->samples > 3)
        return failed(error, TM_ERR_ARGUMENT,
                      "a picture is 16 to 8192 pixels wide and high, with 1 to 3 samples; choose another --size");
    view_renderer *r = calloc(1, sizeof *r);
    if (!r) return failed(error, TM_ERR_MEMORY, "no memory for the renderer; choose a smaller --size");
    r->def = *def;
    r->width = def->width * def->samples, r->height = def->height * def->samples;
    r->buffer = malloc((size_t)r->width * (size_t)r->height * 4);
    r->skin = view_skin_create(def->levels, def->crease_rad);
    if (!r->buffer || !r->skin) {
        renderer_destroy(r);
        return failed(error, TM_ERR_MEMORY, "no memory for the renderer; choose a smaller --size");
    }
    r->context = view_context_open(r->width, r->height, r->buffer, error);
    if (!r->context) return renderer_destroy(r), TM_ERR_LIMIT;
    tm_status status = programs_create(r, error);
    if (status) return renderer_destroy(r), status;
    batch_create(&r->tissue);
    batch_create(&r->tools);
    batch_create(&r->arrows);
    batch_create(&r->marks);
    targets_create(r);
    if (!picture_target_create(r)) {
        renderer_destroy(r);
        return failed(error, TM_ERR_LIMIT,
                      "OpenGL gives no picture with smooth edges; install libosmesa6 22.3 or later");
    }
    *out = r;
    return TM_OK;
}

static void multiply(const float a[16], const float b[16], float c[16]) {
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) {
            float sum = 0;
            for (int k = 0; k < 4; k++) sum += a[4 * k + i] * b[4 * j + k];
            c[4 * j + i] = sum;
        }
}

/* Parallel projection along `towards` (a unit vector to the lamp) of a ball, to the cube -1..1. */
static void parallel(const float towards[3], const float middle[3], float radius, float m[16]) {
    float u[3], v[3];
    view_frame(towards, u, v);
    for (int k = 0; k < 3; k++)
        m[4 * k] = u[k] / radius, m[4 * k + 1] = v[k] / radius, m[4 * k + 2] = -towards[k] / radius, m[4 * k + 3] = 0;
    for (int row = 0; row < 3; row++)
        m[12 + row] = -(m[row] * middle[0] + m[4 + row] * middle[1] + m[8 + row] * middle[2]);
    m[15] = 1;
}

/* Flattens everything along `towards` onto the floor, in the floor's own coordinates. */
static void flatten(const scene *s, const float towards[3], float m[16]) {
    float height = towards[0] * s->up[0] + towards[1] * s->up[1] + towards[2] * s->up[2];
    memset(m, 0, 16 * sizeof *m);
    const float *axis[2] = {s->across, s->along};
    for (int row = 0; row < 2; row++) {
        float slide = (towards[0] * axis[row][0] + towards[1] * axis[row][1] + towards[2] * axis[row][2]) / height;
        for (int k = 0; k < 3; k++) {
            m[4 * k + row] = (axis[row][k] - slide * s->up[k]) / s->spot_size;
            m[12 + row] -= m[4 * k + row] * s->middle[k];
        }
    }
    m[15] = 1;
}

static void normalise(float a[3]) {
    float length = sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int k = 0; k < 3; k++) a[k] /= length > 0 ? length : 1;
}

static void set_scene(const view_renderer *r, const view_camera *c, scene *s) {
    float view[16], projection[16], back[3], flat_back[3];
    view_camera_matrices(c, r->width, r->height, view, projection);
    multiply(projection, view, s->to_clip);
    memcpy(s->eye, c->eye_m, sizeof s->eye);
    memcpy(s->up, c->up, sizeof s->up);
    s->radius = c->radius_m;
    const float right[3] = {view[0], view[4], view[8]};
    for (int k = 0; k < 3; k++) back[k] = view[4 * k + 2];
    float rise = back[0] * s->up[0] + back[1] * s->up[1] + back[2] * s->up[2];
    for (int k = 0; k < 3; k++) flat_back[k] = back[k] - rise * s->up[k];
    normalise(flat_back);
    for (int k = 0; k < 3; k++) {
        s->key[k] = 1.15f * s->up[k] - 0.75f * right[k] + 0.45f * flat_back[k];
        s->fill[k] = 0.45f * s->up[k] + 0.85f * right[k] + 0.55f * flat_back[k];
        s->across[k] = right[k];
        s->along[k] = flat_back[k];
    }
    normalise(s->key);
    normalise(s->fill);
    float height = c->middle_m[0] * s->up[0] + c->middle_m[1] * s->up[1] + c->middle_m[2] * s->up[2];
    for (int k = 0; k < 3; k++) s->middle[k] = c->middle_m[k] + (c->floor_m - height) * s->up[k];
    parallel(s->key, c->middle_m, 1.25f * c->radius_m, s->to_light);
    s->spot_size = 2.2f * c->radius_m;
}

static void fill_batch(batch *b, const view_vertex *vertex, int32_t count) {
    b->count = count;
    glBindBuffer(GL_ARRAY_BUFFER, b->vertices);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)((size_t)count * sizeof *vertex), vertex, GL_STREAM_DRAW);
}

static void fill_indices(const batch *b, GLuint buffer, const uint32_t *index, int32_t count) {
    glBindVertexArray(b->array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffer);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)((size_t)count * sizeof *index), index, GL_DYNAMIC_DRAW);
}

static double length3(const double v[3]) { return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

static float grain(float radius_m) { return radius_m / 90; }

static tm_status upload(view_renderer *r, const view_picture *p, const view_camera *camera, tm_error *error) {
    if (!view_skin_update(r->skin, &p->surface, grain(camera->radius_m)))
        return failed(error, TM_ERR_MEMORY, "no memory for the tissue's skin; choose a smaller --smooth");
    const view_vertex *vertex;
    const uint32_t *index = NULL;
    bool changed;
    int32_t vertices = view_skin_vertices(r->skin, &vertex);
    fill_batch(&r->tissue, vertex, vertices);
    r->tissue.count = view_skin_indices(r->skin, &index, &changed);
    if (changed) {
        fill_indices(&r->tissue, r->tissue.indices, index, r->tissue.count);
        r->tissue.coarse_count = view_skin_coarse_indices(r->skin, &index);
        fill_indices(&r->tissue, r->tissue.coarse_indices, index, r->tissue.coarse_count);
    }
    r->tool_shape.count = r->arrow_shape.count = 0;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) {
        const view_instrument *t = &p->instrument[i];
        if (!t->shown) continue;
        view_shape_instrument(&r->tool_shape, t);
        double along[3];
        for (int k = 0; k < 3; k++) along[k] = t->force_N[k] * p->newton_m;
        if (length3(along) > 0.01 * camera->radius_m)
            view_shape_arrow(&r->arrow_shape, t->tip_m, along,
                             fminf(0.022f * camera->radius_m, (float)length3(along) / 4),
                             i ? VIEW_PAINT_ARROW_1 : VIEW_PAINT_ARROW_0, camera);
    }
    r->shadow_count =
        r->tool_shape.count; /* ports hang in a wall that is not drawn: their shadows would come from nowhere */
    for (int i = 0; i < VIEW_INSTRUMENTS; i++)
        if (p->instrument[i].shown) view_shape_port(&r->tool_shape, &p->instrument[i]);
    r->mark_shape.count = 0;
    if (p->marks) view_shape_supports(&r->mark_shape, p->marks, &p->surface, 0.013f * camera->radius_m);
    r->support_count = r->mark_shape.count;
    if (p->marks) view_shape_fibres(&r->mark_shape, p->marks, &p->surface);
    fill_batch(&r->marks, r->mark_shape.vertex, r->mark_shape.count);
    fill_batch(&r->tools, r->tool_shape.vertex, r->tool_shape.count);
    fill_batch(&r->arrows, r->arrow_shape.vertex, r->arrow_shape.count);
    return TM_OK;
}

static void draw_tissue(const view_renderer *r, bool coarse) {
    glBindVertexArray(r->tissue.array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, coarse ? r->tissue.coarse_indices : r->tissue.indices);
    glDrawElements(GL_TRIANGLES, coarse ? r->tissue.coarse_count : r->tissue.count, GL_UNSIGNED_INT, NULL);
}

static void draw_batch(const batch *b) {
    glBindVertexArray(b->array);
    glDrawArrays(GL_TRIANGLES, 0, b->count);
}

/* Fibres and supports; supports behind the tissue shine through it. */
static void draw_marks(const view_renderer *r) {
    draw_batch(&r->marks);
    if (!r->support_count) return;
    glDepthFunc(GL_GREATER);
    glDepthMask(GL_FALSE);
    glEnable(GL_BLEND);
    glBlendColor(0, 0, 0, 0.28f);
    glBlendFunc(GL_CONSTANT_ALPHA, GL_ONE_MINUS_CONSTANT_ALPHA);
    glDrawArrays(GL_TRIANGLES, 0, r->support_count);
    glDisable(GL_BLEND);
    glDepthMask(GL_TRUE);
    glDepthFunc(GL_LESS);
}

static void uniform3(GLuint program_id, const char *name, const float v[3]) {
    glUniform3fv(glGetUniformLocation(program_id, name), 1, v);
}

static void uniform_matrix(GLuint program_id, const char *name, const float m[16]) {
    glUniformMatrix4fv(glGetUniformLocation(program_id, name), 1, GL_FALSE, m);
}

/* Everything that throws a shadow, as seen through `m`. */
static void draw_depth(const view_renderer *r, const float m[16], bool coarse) {
    glUseProgram(r->depth_program);
    uniform_matrix(r->depth_program, "to_clip", m);
    draw_tissue(r, coarse);
    glBindVertexArray(r->tools.array);
    glDrawArrays(GL_TRIANGLES, 0, r->shadow_count);
}

static void pass_shadow(const view_renderer *r, const scene *s) {
    glBindFramebuffer(GL_FRAMEBUFFER, r->shadow_target);
    glViewport(0, 0, SHADOW_PX, SHADOW_PX);
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_DEPTH_CLAMP);
    glClear(GL_DEPTH_BUFFER_BIT);
    draw_depth(r, s->to_light, false);
    glDisable(GL_DEPTH_CLAMP);
}

/* The soft spot on the floor from one direction, into spot texture `into`; texture 2 is scratch. */
static void pass_spot(const view_renderer *r, const scene *s, const float towards[3], int into, float softness) {
    float m[16];
    flatten(s, towards, m);
    glDisable(GL_DEPTH_TEST);
    glViewport(0, 0, SPOT_PX, SPOT_PX);
    glBindFramebuffer(GL_FRAMEBUFFER, r->spot_target[into]);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT);
    draw_depth(r, m, true);
    glUseProgram(r->blur_program);
    glBindVertexArray(r->empty);
    glActiveTexture(GL_TEXTURE0);
    glUniform1i(glGetUniformLocation(r->blur_program, "image"), 0);
    for (int pass = 0; pass < 2; pass++) {
        glBindFramebuffer(GL_FRAMEBUFFER, r->spot_target[pass ? into : 2]);
        glBindTexture(GL_TEXTURE_2D, r->spot_texture[pass ? 2 : into]);
        glUniform2f(glGetUniformLocation(r->blur_program, "stride"), pass ? 0 : softness / SPOT_PX,
                    pass ? softness / SPOT_PX : 0);
        glDrawArrays(GL_TRIANGLES, 0, 3);
    }
}

static void pass_background(const view_renderer *r, const scene *s) {
    glDisable(GL_DEPTH_TEST);
    glBindVertexArray(r->empty);
    glUseProgram(r->sky_program);
    uniform3(r->sky_program, "low", sky_low);
    uniform3(r->sky_program, "high", sky_high);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glEnable(GL_DEPTH_TEST);
    GLuint id = r->floor_program;
    glUseProgram(id);
    uniform_matrix(id, "to_clip", s->to_clip);
    const struct {
        const char *name;
        const float *v;
    } vectors[] = {{"middle", s->middle}, {"across", s->across}, {"along", s->along}, {"eye", s->eye},
                   {"up", s->up},         {"low", sky_low},      {"high", sky_high}};
    for (size_t i = 0; i < sizeof vectors / sizeof vectors[0]; i++) uniform3(id, vectors[i].name, vectors[i].v);
    glUniform1f(glGetUniformLocation(id, "size"), 8 * s->radius);
    glUniform1f(glGetUniformLocation(id, "spot_size"), s->spot_size);
    glUniform1f(glGetUniformLocation(id, "radius"), s->radius);
    glUniform2f(glGetUniformLocation(id, "screen"), (float)r->width, (float)r->height);
    for (int i = 0; i < 2; i++) {
        glActiveTexture(GL_TEXTURE0 + (GLenum)i);
        glBindTexture(GL_TEXTURE_2D, r->spot_texture[i]);
        glUniform1i(glGetUniformLocation(id, i ? "sky_spot" : "key_spot"), i);
    }
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
}

static void use_lit(const view_renderer *r, const scene *s, GLuint id) {
    glUseProgram(id);
    uniform_matrix(id, "to_clip", s->to_clip);
    uniform_matrix(id, "to_light", s->to_light);
    uniform3(id, "eye", s->eye);
    uniform3(id, "key", s->key);
    uniform3(id, "fill", s->fill);
    uniform3(id, "up", s->up);
    glUniform1f(glGetUniformLocation(id, "grain_m"), grain(s->radius));
    glUniform1f(glGetUniformLocation(id, "texel"), 1.0f / SHADOW_PX);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, r->shadow_texture);
    glUniform1i(glGetUniformLocation(id, "shadow"), 0);
}

/* Averages samples*samples drawn pixels into one, and turns the picture the right way up. */
static void gather(const view_renderer *r, uint8_t *rgb) {
    int n = r->def.samples, w = r->def.width, h = r->def.height, area = n * n;
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            int sum[3] = {area / 2, area / 2, area / 2};
            for (int j = 0; j < n; j++) {
                const uint8_t *p = r->buffer + 4 * ((size_t)(n * (h - 1 - y) + j) * (size_t)r->width + (size_t)(n * x));
                for (int i = 0; i < n; ++i, p += 4) sum[0] += p[0], sum[1] += p[1], sum[2] += p[2];
            }
            for (int k = 0; k < 3; k++)
                rgb[3 * ((size_t)y * (size_t)w + (size_t)x) + (size_t)k] = (uint8_t)(sum[k] / area);
        }
}

static tm_status renderer_draw(view_renderer *r, const view_picture *p, const view_camera *camera, uint8_t *rgb,
                               tm_error *error) {
    if (!view_context_use(r->context)) return failed(error, TM_ERR_LIMIT, "the drawing context was lost; start anew");
    tm_status status = upload(r, p, camera, error);
    if (status) return status;
    scene s;
    set_scene(r, camera, &s);
    pass_shadow(r, &s);
    pass_spot(r, &s, s.key, 0, 0.8f);
    pass_spot(r, &s, s.up, 1, 2.0f);
    glBindFramebuffer(GL_FRAMEBUFFER, r->picture_target);
    glViewport(0, 0, r->width, r->height);
    glClear(GL_DEPTH_BUFFER_BIT);
    pass_background(r, &s);
    use_lit(r, &s, r->tissue_program);
    draw_tissue(r, false);
    use_lit(r, &s, r->metal_program);
    draw_marks(r); /* before the tools, which hide what shines through the tissue */
    draw_batch(&r->tools);
    glClear(
        GL_DEPTH_BUFFER_BIT); /* arrows are seen through everything: a force often points back along its instrument */
    draw_batch(&r->arrows);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, r->whole_target);
    glBlitFramebuffer(0, 0, r->width, r->height, 0, 0, r->width, r->height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glFinish();
    if (r->whole_target) {
        glBindFramebuffer(GL_READ_FRAMEBUFFER, r->whole_target);
        glReadPixels(0, 0, r->width, r->height, GL_RGBA, GL_UNSIGNED_BYTE, r->buffer);
    }
    if (glGetError() != GL_NO_ERROR)
        return failed(error, TM_ERR_LIMIT, "OpenGL refused a drawing command; install libosmesa6 22.3 or later");
    gather(r, rgb);
    return TM_OK;
}

static const char *renderer_name(view_renderer *r) {
    return view_context_use(r->context) ? (const char *)glGetString(GL_RENDERER) : "";
}

__attribute__((visibility("default"))) extern const view_render_api view_render_functions;
const view_render_api view_render_functions = {renderer_create, renderer_destroy, renderer_draw, renderer_name};
