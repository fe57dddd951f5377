/* Draws a picture pass by pass: shadows, background, tissue, tools and marks. */
#include "render_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* --- one picture's lamps, floor and projection --- */

static void multiply(const float a[16], const float b[16], float c[16]) {
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) {
            float sum = 0;
            for (int k = 0; k < 4; k++) sum += a[4 * k + i] * b[4 * j + k];
            c[4 * j + i] = sum;
        }
}

/* Computes the parallel projection of a ball along `towards` (a unit vector to the lamp) to the cube -1..1. */
static void parallel(const float towards[3], const float middle[3], float radius, float m[16]) {
    float u[3], v[3];
    view_frame(towards, u, v);
    for (int k = 0; k < 3; k++)
        m[4 * k] = u[k] / radius, m[4 * k + 1] = v[k] / radius, m[4 * k + 2] = -towards[k] / radius, m[4 * k + 3] = 0;
    for (int row = 0; row < 3; row++)
        m[12 + row] = -(m[row] * middle[0] + m[4 + row] * middle[1] + m[8 + row] * middle[2]);
    m[15] = 1;
}

/* Computes the projection along `towards` onto the floor, in the floor's coordinates. */
static void view_light_flatten(const view_light *s, const float towards[3], float m[16]) {
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

static void view_light_normalise(float a[3]) {
    float length = sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int k = 0; k < 3; k++) a[k] /= length > 0 ? length : 1;
}

/* Places lamps and floor relative to this picture's camera. */
static void view_light_set(const view_renderer *r, const view_camera *c, view_light *s) {
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
    view_light_normalise(flat_back);
    for (int k = 0; k < 3; k++) {
        s->key[k] = 1.15f * s->up[k] - 0.75f * right[k] + 0.45f * flat_back[k];
        s->fill[k] = 0.45f * s->up[k] + 0.85f * right[k] + 0.55f * flat_back[k];
        s->across[k] = right[k];
        s->along[k] = flat_back[k];
    }
    view_light_normalise(s->key);
    view_light_normalise(s->fill);
    float height = c->middle_m[0] * s->up[0] + c->middle_m[1] * s->up[1] + c->middle_m[2] * s->up[2];
    for (int k = 0; k < 3; k++) s->middle[k] = c->middle_m[k] + (c->floor_m - height) * s->up[k];
    parallel(s->key, c->middle_m, 1.25f * c->radius_m, s->to_light);
    s->spot_size = 2.2f * c->radius_m;
}

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"
static const float sky_low[3] = {0.052f, 0.062f, 0.070f}, sky_high[3] = {0.20f, 0.235f, 0.26f};

static void fill_batch(view_batch *b, const view_vertex *vertex, int32_t count) {
    b->count = count;
    glBindBuffer(GL_ARRAY_BUFFER, b->vertices);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)((size_t)count * sizeof *vertex), vertex, GL_STREAM_DRAW);
}

static void fill_indices(const view_batch *b, GLuint buffer, const uint32_t *index, int32_t count) {
    glBindVertexArray(b->array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffer);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)((size_t)count * sizeof *index), index, GL_DYNAMIC_DRAW);
}

static float grain(float radius_m) { return radius_m / 90; }

static tm_status upload(view_renderer *r, const view_picture *p, const view_camera *camera, tm_error *error) {
    if (!view_skin_update(r->skin, &p->surface, grain(camera->radius_m)))
        return view_render_failed(error, TM_ERR_MEMORY,
                                  "no memory for the tissue's surface; choose a smaller --smooth");
    const view_vertex *vertex;
    const uint32_t *index = NULL;
    bool changed;
    int32_t vertices = view_skin_vertices(r->skin, &vertex);
    fill_batch(&r->tissue, vertex, vertices);
    r->tissue.count = view_skin_indices(r->skin, &index, &changed);
    if (changed) {
        fill_indices(&r->tissue, r->tissue.indices, index, r->tissue.count);
        r->tissue.inside_count = view_skin_inside(r->skin);
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
        if (vnorm(along) > 0.01 * camera->radius_m)
            view_shape_arrow(&r->arrow_shape, t->tip_m, along,
                             fminf(0.022f * camera->radius_m, (float)vnorm(along) / 4),
                             i ? VIEW_PAINT_ARROW_1 : VIEW_PAINT_ARROW_0, camera);
    }
    r->shadow_count =
        r->tool_shape.count; /* ports hang in a wall that is not drawn: their shadows would have no visible cause */
    for (int i = 0; i < VIEW_INSTRUMENTS; i++)
        if (p->instrument[i].shown) view_shape_port(&r->tool_shape, &p->instrument[i]);
    r->mark_shape.count = 0;
    view_surface drawn = p->surface;
    drawn.vertex_m = view_skin_places(r->skin);
    if (p->marks) view_shape_supports(&r->mark_shape, p->marks, &drawn, 0.013f * camera->radius_m);
    r->support_count = r->mark_shape.count;
    if (p->marks) view_shape_fibres(&r->mark_shape, p->marks, &drawn);
    view_shape_ties(&r->mark_shape, &p->ties, 0.0045f * camera->radius_m);
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

/* Sets the regions' colours in the tissue's shader. */
static void set_tints(GLuint id, const view_picture *p) {
    float tint[4 * VIEW_REGIONS] = {0};
    for (int i = 0; i < p->regions; i++) {
        memcpy(tint + 4 * i, p->region[i].rgb, sizeof p->region[i].rgb);
        tint[4 * i + 3] = p->region[i].tinted;
    }
    glUniform4fv(glGetUniformLocation(id, "tint"), VIEW_REGIONS, tint);
}

/* Draws the inner regions, then the nearest layer of the outer surface over them, translucent. */
static void draw_tissue_through(const view_renderer *r, float through) {
    const size_t inside = (size_t)r->tissue.inside_count;
    const GLsizei outside = r->tissue.count - r->tissue.inside_count;
    const void *from = (const void *)(inside * sizeof(uint32_t));
    glBindVertexArray(r->tissue.array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, r->tissue.indices);
    glDrawElements(GL_TRIANGLES, r->tissue.inside_count, GL_UNSIGNED_INT, NULL);
    glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
    glDrawElements(GL_TRIANGLES, outside, GL_UNSIGNED_INT, from);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glDepthFunc(GL_EQUAL);
    glEnable(GL_BLEND);
    glBlendColor(0, 0, 0, 1 - through);
    glBlendFunc(GL_CONSTANT_ALPHA, GL_ONE_MINUS_CONSTANT_ALPHA);
    glDrawElements(GL_TRIANGLES, outside, GL_UNSIGNED_INT, from);
    glDisable(GL_BLEND);
    glDepthFunc(GL_LESS);
}

static void draw_batch(const view_batch *b) {
    glBindVertexArray(b->array);
    glDrawArrays(GL_TRIANGLES, 0, b->count);
}

/* Draws fibres, ties and supports; supports behind the tissue are visible through it. */
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

/* Draws everything that casts a shadow, seen through `m`. */
static void draw_depth(const view_renderer *r, const float m[16], bool coarse) {
    glUseProgram(r->depth_program);
    uniform_matrix(r->depth_program, "to_clip", m);
    draw_tissue(r, coarse);
    glBindVertexArray(r->tools.array);
    glDrawArrays(GL_TRIANGLES, 0, r->shadow_count);
}

static void pass_shadow(const view_renderer *r, const view_light *s) {
    glBindFramebuffer(GL_FRAMEBUFFER, r->shadow_target);
    glViewport(0, 0, VIEW_SHADOW_PX, VIEW_SHADOW_PX);
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_DEPTH_CLAMP);
    glClear(GL_DEPTH_BUFFER_BIT);
    draw_depth(r, s->to_light, false);
    glDisable(GL_DEPTH_CLAMP);
}

/* Draws the soft shadow on the floor from one direction into spot texture `into`; texture 2 is scratch. */
static void pass_spot(const view_renderer *r, const view_light *s, const float towards[3], int into, float softness) {
    float m[16];
    view_light_flatten(s, towards, m);
    glDisable(GL_DEPTH_TEST);
    glViewport(0, 0, VIEW_SPOT_PX, VIEW_SPOT_PX);
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
        glUniform2f(glGetUniformLocation(r->blur_program, "stride"), pass ? 0 : softness / VIEW_SPOT_PX,
                    pass ? softness / VIEW_SPOT_PX : 0);
        glDrawArrays(GL_TRIANGLES, 0, 3);
    }
}

static void pass_background(const view_renderer *r, const view_light *s) {
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

static void use_lit(const view_renderer *r, const view_light *s, GLuint id) {
    glUseProgram(id);
    uniform_matrix(id, "to_clip", s->to_clip);
    uniform_matrix(id, "to_light", s->to_light);
    uniform3(id, "eye", s->eye);
    uniform3(id, "key", s->key);
    uniform3(id, "fill", s->fill);
    uniform3(id, "up", s->up);
    glUniform1f(glGetUniformLocation(id, "grain_m"), grain(s->radius));
    glUniform1f(glGetUniformLocation(id, "texel"), 1.0f / VIEW_SHADOW_PX);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, r->shadow_texture);
    glUniform1i(glGetUniformLocation(id, "shadow"), 0);
}

/* Averages samples*samples drawn pixels into one and flips the picture vertically. */
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
    if (!view_context_use(r->context))
        return view_render_failed(error, TM_ERR_LIMIT, "the drawing context was lost; start again");
    tm_status status = upload(r, p, camera, error);
    if (status) return status;
    view_light s;
    view_light_set(r, camera, &s);
    pass_shadow(r, &s);
    pass_spot(r, &s, s.key, 0, 0.8f);
    pass_spot(r, &s, s.up, 1, 2.0f);
    glBindFramebuffer(GL_FRAMEBUFFER, r->picture_target);
    glViewport(0, 0, r->width, r->height);
    glClear(GL_DEPTH_BUFFER_BIT);
    pass_background(r, &s);
    use_lit(r, &s, r->tissue_program);
    set_tints(r->tissue_program, p);
    if (p->through > 0)
        draw_tissue_through(r, p->through);
    else
        draw_tissue(r, false);
    use_lit(r, &s, r->metal_program);
    draw_marks(r); /* before the tools, which occlude marks behind the tissue */
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
        return view_render_failed(error, TM_ERR_LIMIT,
                                  "OpenGL refused a drawing command; install libosmesa6 22.3 or later");
    gather(r, rgb);
    return TM_OK;
}

static const char *renderer_name(view_renderer *r) {
    return view_context_use(r->context) ? (const char *)glGetString(GL_RENDERER) : "";
}

__attribute__((visibility("default"))) extern const view_render_api view_render_functions;
const view_render_api view_render_functions = {view_renderer_create, view_renderer_destroy, renderer_draw,
                                               renderer_name};
