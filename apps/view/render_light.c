/* One picture's lamps, floor and projection. */
#include <math.h>
#include <string.h>

#include "render_parts.h"

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

void view_light_flatten(const view_light *s, const float towards[3], float m[16]) {
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

void view_light_normalise(float a[3]) {
    float length = sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int k = 0; k < 3; k++) a[k] /= length > 0 ? length : 1;
}

void view_light_set(const view_renderer *r, const view_camera *c, view_light *s) {
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
