#include "shapes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "camera.h"

enum { AROUND = 24, JAW_STEPS = 24 };
static const float PI = 3.14159265f;

/* A position and three directions; w is the axis. */
typedef struct frame {
    float o[3], u[3], v[3], w[3];
} frame;
typedef struct ring {
    float along_m, radius_m;
} ring;

void view_shape_free(view_shape *shape) {
    free(shape->vertex);
    memset(shape, 0, sizeof *shape);
}

static void place(const frame *f, const float local[3], bool direction, float out[3]) {
    for (int k = 0; k < 3; k++)
        out[k] = (direction ? 0 : f->o[k]) + local[0] * f->u[k] + local[1] * f->v[k] + local[2] * f->w[k];
}

static void add(view_shape *s, const frame *f, const float at[3], const float normal[3], int paint) {
    if (s->count == s->capacity) {
        int32_t capacity = s->capacity ? 2 * s->capacity : 8192;
        view_vertex *larger = realloc(s->vertex, (size_t)capacity * sizeof *larger);
        if (!larger) return;
        s->vertex = larger, s->capacity = capacity;
    }
    view_vertex *v = &s->vertex[s->count++];
    place(f, at, false, v->at_m);
    place(f, normal, true, v->normal);
    memcpy(v->reference_m, at, sizeof v->reference_m);
    v->kind = (float)paint, v->shade = 1;
}

void view_shape_point(view_shape *s, const float at_m[3], const float normal[3], int paint) {
    static const frame world = {{0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    add(s, &world, at_m, normal, paint);
}

static void quad(view_shape *s, const frame *f, const float at[4][3], const float normal[4][3], int paint) {
    static const int corner[6] = {0, 1, 2, 0, 2, 3};
    for (int i = 0; i < 6; i++) add(s, f, at[corner[i]], normal[corner[i]], paint);
}

/* Appends a body of revolution; each section between two rings is shaded as a separate cone, so that steps stay
 * sharp. */
static void lathe(view_shape *s, const frame *f, const ring *r, int count, int paint) {
    for (int i = 0; i + 1 < count; i++) {
        float dr = r[i + 1].radius_m - r[i].radius_m, dz = r[i + 1].along_m - r[i].along_m,
              length = sqrtf(dr * dr + dz * dz);
        if (length <= 0) continue;
        float out = dz / length, up = -dr / length;
        for (int j = 0; j < AROUND; j++) {
            float a = 2 * PI * (float)j / AROUND, b = 2 * PI * (float)(j + 1) / AROUND, ca = cosf(a), sa = sinf(a),
                  cb = cosf(b), sb = sinf(b);
            const float at[4][3] = {{r[i].radius_m * ca, r[i].radius_m * sa, r[i].along_m},
                                    {r[i].radius_m * cb, r[i].radius_m * sb, r[i].along_m},
                                    {r[i + 1].radius_m * cb, r[i + 1].radius_m * sb, r[i + 1].along_m},
                                    {r[i + 1].radius_m * ca, r[i + 1].radius_m * sa, r[i + 1].along_m}};
            const float n[4][3] = {
                {out * ca, out * sa, up}, {out * cb, out * sb, up}, {out * cb, out * sb, up}, {out * ca, out * sa, up}};
            quad(s, f, at, n, paint);
        }
    }
}

/* Appends a round end at `along`: rings of a quarter circle with the sphere's normals. */
static void dome(view_shape *s, const frame *f, float along, float radius, int paint) {
    enum { STEPS = 5 };
    for (int i = 0; i < STEPS; i++) {
        float p = PI / 2 * (float)i / STEPS, q = PI / 2 * (float)(i + 1) / STEPS;
        for (int j = 0; j < AROUND; j++) {
            float a = 2 * PI * (float)j / AROUND, b = 2 * PI * (float)(j + 1) / AROUND;
            const float n[4][3] = {{cosf(p) * cosf(a), cosf(p) * sinf(a), sinf(p)},
                                   {cosf(p) * cosf(b), cosf(p) * sinf(b), sinf(p)},
                                   {cosf(q) * cosf(b), cosf(q) * sinf(b), sinf(q)},
                                   {cosf(q) * cosf(a), cosf(q) * sinf(a), sinf(q)}};
            float at[4][3];
            for (int c = 0; c < 4; c++)
                for (int k = 0; k < 3; k++) at[c][k] = radius * n[c][k] + (k == 2 ? along : 0);
            quad(s, f, (const float(*)[3])at, n, paint);
        }
    }
}

/* Appends half a tapering rod with a toothed flat inner side, opened by `angle` about its root. */
static void jaw(view_shape *s, const frame *tip, float side, float angle, float length, float radius) {
    enum { ACROSS = 10 };
    frame f = *tip;
    for (int k = 0; k < 3; k++) {
        f.o[k] = tip->o[k] - length * tip->w[k];
        f.u[k] = side * cosf(angle) * tip->u[k] - sinf(angle) * tip->w[k];
        f.w[k] = side * sinf(angle) * tip->u[k] + cosf(angle) * tip->w[k];
        f.v[k] = side * tip->v[k];
    }
    for (int i = 0; i < JAW_STEPS; i++) {
        float z[2], r[2], tooth[2];
        for (int e = 0; e < 2; e++) {
            float t = (float)(i + e) / JAW_STEPS;
            z[e] = t * (length + 0.8f * radius);
            r[e] = radius * (1 - 0.35f * t) * sqrtf(fmaxf(1 - powf(t, 14), 0));
            tooth[e] = (i + e) % 2 ? 0.20f * r[e] : 0.04f * r[e];
        }
        for (int j = 0; j < ACROSS; j++) {
            float a = PI * ((float)j / ACROSS - 0.5f), b = PI * ((float)(j + 1) / ACROSS - 0.5f);
            const float at[4][3] = {{r[0] * cosf(a), r[0] * sinf(a), z[0]},
                                    {r[0] * cosf(b), r[0] * sinf(b), z[0]},
                                    {r[1] * cosf(b), r[1] * sinf(b), z[1]},
                                    {r[1] * cosf(a), r[1] * sinf(a), z[1]}};
            float up = i < JAW_STEPS - 3 ? 0.05f : 0.8f;
            const float n[4][3] = {
                {cosf(a), sinf(a), up}, {cosf(b), sinf(b), up}, {cosf(b), sinf(b), up}, {cosf(a), sinf(a), up}};
            quad(s, &f, at, n, VIEW_PAINT_STEEL);
        }
        float slope = (tooth[1] - tooth[0]) / (z[1] - z[0]), norm = sqrtf(1 + slope * slope);
        const float flat[4][3] = {
            {tooth[0], r[0], z[0]}, {tooth[0], -r[0], z[0]}, {tooth[1], -r[1], z[1]}, {tooth[1], r[1], z[1]}};
        const float n1[3] = {-1 / norm, 0, slope / norm};
        const float n[4][3] = {{n1[0], 0, n1[2]}, {n1[0], 0, n1[2]}, {n1[0], 0, n1[2]}, {n1[0], 0, n1[2]}};
        quad(s, &f, flat, n, VIEW_PAINT_STEEL);
    }
}

static frame tip_frame(const view_instrument *t) {
    frame f;
    for (int k = 0; k < 3; k++)
        f.o[k] = (float)t->tip_m[k], f.w[k] = (float)(t->is_free ? t->direction[k] : t->tip_m[k] - t->trocar_m[k]);
    float length = sqrtf(f.w[0] * f.w[0] + f.w[1] * f.w[1] + f.w[2] * f.w[2]);
    for (int k = 0; k < 3; k++) f.w[k] = length > 0 ? f.w[k] / length : (float)-(k == 2);
    float u[3], v[3], c = cosf((float)t->roll_rad), s = sinf((float)t->roll_rad);
    view_frame(f.w, u, v);
    for (int k = 0; k < 3; k++) f.u[k] = c * u[k] + s * v[k], f.v[k] = c * v[k] - s * u[k];
    return f;
}

/* Returns the length of shaft to draw in front of the trocar; of a free instrument, 12 cm. */
static float inside_m(const view_instrument *t) {
    double sum = 0;
    if (t->is_free) return 0.12f;
    for (int k = 0; k < 3; k++) sum += (t->tip_m[k] - t->trocar_m[k]) * (t->tip_m[k] - t->trocar_m[k]);
    return (float)sqrt(sum);
}

void view_shape_instrument(view_shape *s, const view_instrument *t) {
    frame f = tip_frame(t);
    float r = (float)t->radius_m, inside = inside_m(t);
    float back = -(inside + 60 * r);
    if (t->mode == HRT_MODE_GRASPER) {
        float length = 6.4f * r, open = 0.42f * (float)(1 - fmin(fmax(t->grip, 0), 1));
        const ring shaft[] = {{back, r}, {-length - 2.2f * r, r}};
        const ring wrist[] = {{-length - 2.2f * r, r},
                              {-length - 2.2f * r, 0.9f * r},
                              {-length - 0.6f * r, 0.9f * r},
                              {-length, 0.7f * r},
                              {-length + 0.8f * r, 0}};
        lathe(s, &f, shaft, 2, VIEW_PAINT_SLEEVE);
        lathe(s, &f, wrist, 5, VIEW_PAINT_STEEL);
        jaw(s, &f, 1, open, length, 0.95f * r);
        jaw(s, &f, -1, open, length, 0.95f * r);
    } else if (t->mode == HRT_MODE_CAUTERY) {
        int paint = t->active ? VIEW_PAINT_HOT : VIEW_PAINT_STEEL;
        const ring shaft[] = {{back, r}, {-6 * r, r}};
        const ring collar[] = {{-6 * r, r}, {-5.4f * r, 0.75f * r}, {-4.6f * r, 0.75f * r}};
        const ring rod[] = {{-4.6f * r, 0.75f * r},
                            {-4.2f * r, 0.42f * r},
                            {-1.2f * r, 0.42f * r},
                            {-0.4f * r, 0.8f * r},
                            {0, 0.8f * r}};
        lathe(s, &f, shaft, 2, VIEW_PAINT_SLEEVE);
        lathe(s, &f, collar, 3, VIEW_PAINT_PORT);
        lathe(s, &f, rod, 5, paint);
        dome(s, &f, 0, 0.8f * r, paint);
    } else {
        const ring shaft[] = {{back, r}, {-7 * r, r}};
        const ring end[] = {{-7 * r, r}, {-7 * r, 0.92f * r}, {0, 0.92f * r}};
        lathe(s, &f, shaft, 2, VIEW_PAINT_SLEEVE);
        lathe(s, &f, end, 3, VIEW_PAINT_STEEL);
        dome(s, &f, 0, 0.92f * r, VIEW_PAINT_STEEL);
    }
}

void view_shape_port(view_shape *s, const view_instrument *t) {
    frame f = tip_frame(t);
    float r = (float)t->radius_m, inside = inside_m(t);
    const ring port[] = {{-inside - 14 * r, 0},          {-inside - 14 * r, 4.4f * r}, {-inside - 9 * r, 4.4f * r},
                         {-inside - 8.4f * r, 3.8f * r}, {-inside - 6 * r, 2 * r},     {-inside + 6 * r, 2 * r},
                         {-inside + 6 * r, 1.2f * r}};
    lathe(s, &f, port, 7, VIEW_PAINT_PORT);
}

void view_shape_strand(view_shape *s, const float from_m[3], const float to_m[3], float radius_m, int paint) {
    frame f;
    float length = 0;
    for (int k = 0; k < 3; k++) f.o[k] = from_m[k], f.w[k] = to_m[k] - from_m[k], length += f.w[k] * f.w[k];
    length = sqrtf(length);
    if (!(length > 0)) return;
    for (int k = 0; k < 3; k++) f.w[k] /= length;
    view_frame(f.w, f.u, f.v);
    const ring strand[] = {
        {0, 1.5f * radius_m}, {0.25f * length, radius_m}, {0.75f * length, radius_m}, {length, 1.5f * radius_m}};
    lathe(s, &f, strand, 4, paint);
}

/* Appends a flat ring perpendicular to w, with a dot or a cross in it. */
static void end_on(view_shape *s, const frame *f, float thickness_m, bool away, int paint) {
    const float n[4][3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}}, r = 1.9f * thickness_m, w = 0.4f * thickness_m;
    for (int j = 0; j < AROUND; j++) {
        float a = 2 * PI * (float)j / AROUND, b = 2 * PI * (float)(j + 1) / AROUND;
        const float band[4][3] = {{(r - w) * cosf(a), (r - w) * sinf(a), 0},
                                  {r * cosf(a), r * sinf(a), 0},
                                  {r * cosf(b), r * sinf(b), 0},
                                  {(r - w) * cosf(b), (r - w) * sinf(b), 0}};
        quad(s, f, band, n, paint);
        const float dot[4][3] = {
            {0, 0, 0}, {1.4f * w * cosf(a), 1.4f * w * sinf(a), 0}, {1.4f * w * cosf(b), 1.4f * w * sinf(b), 0}, {0}};
        if (!away) quad(s, f, dot, n, paint);
    }
    for (int j = 0; away && j < 2; j++) {
        float c = 0.7071f * (r - w), h = 0.35f * w, sign = j ? -1.0f : 1.0f;
        const float bar[4][3] = {{-c - h, sign * (-c + h), 0},
                                 {-c + h, sign * (-c - h), 0},
                                 {c + h, sign * (c - h), 0},
                                 {c - h, sign * (c + h), 0}};
        quad(s, f, bar, n, paint);
    }
}

void view_shape_arrow(view_shape *s, const double from_m[3], const double along_m[3], float thickness_m, int paint,
                      const view_camera *camera) {
    frame f;
    float length = 0;
    for (int k = 0; k < 3; k++) f.o[k] = (float)from_m[k], f.w[k] = (float)along_m[k], length += f.w[k] * f.w[k];
    length = sqrtf(length);
    if (!(length > 0)) return;
    for (int k = 0; k < 3; k++) f.w[k] /= length;
    int facing = view_camera_facing(camera, from_m, along_m);
    if (facing) {
        for (int k = 0; k < 3; k++) f.w[k] = camera->eye_m[k] - f.o[k];
        length = sqrtf(f.w[0] * f.w[0] + f.w[1] * f.w[1] + f.w[2] * f.w[2]);
        for (int k = 0; k < 3; k++) f.w[k] /= length;
    }
    view_frame(f.w, f.u, f.v);
    if (facing) {
        end_on(s, &f, thickness_m, facing < 0, paint);
        return;
    }
    float head = fminf(4.5f * thickness_m, 0.7f * length);
    const ring shaft[] = {{0, 0}, {0, thickness_m / 2}, {length - head, thickness_m / 2}};
    const ring point[] = {{length - head, thickness_m / 2}, {length - head, 1.5f * thickness_m}, {length, 0}};
    lathe(s, &f, shaft, 3, paint);
    lathe(s, &f, point, 3, paint);
}
