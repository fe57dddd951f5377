#include "camera.h"

#include <math.h>
#include <string.h>

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"
static const float PI = 3.14159265f;

static void normalise(float a[3]) {
    float length = sqrtf(vdot(a, a));
    for (int k = 0; k < 3; k++) a[k] = length > 0 ? a[k] / length : (float)(k == 2);
}

void view_frame(const float axis[3], float u[3], float v[3]) {
    float helper[3] = {0, 0, 1};
    if (fabsf(axis[2]) > 0.9f * sqrtf(vdot(axis, axis))) helper[0] = 1, helper[2] = 0;
    vcross(helper, axis, u);
    normalise(u);
    vcross(axis, u, v);
    normalise(v);
}

view_camera_def view_camera_default(void) {
    return (view_camera_def){.azimuth_rad = -110 * PI / 180, .elevation_rad = 40 * PI / 180, .zoom = 1, .up = 'z'};
}

/* Computes unit vectors of the eye's frame: right, up, back (towards the eye). */
static void eye_frame(const view_camera *camera, float right[3], float up[3], float back[3]) {
    for (int k = 0; k < 3; k++) back[k] = camera->eye_m[k] - camera->at_m[k];
    normalise(back);
    vcross(camera->up, back, right);
    normalise(right);
    vcross(back, right, up);
}

static void eye_direction(const view_camera_def *def, float direction[3], float up[3]) {
    int k = def->up == 'x' || def->up == 'X' ? 0 : def->up == 'y' || def->up == 'Y' ? 1 : 2;
    memset(up, 0, 3 * sizeof *up);
    up[k] = def->up < 'a' ? -1 : 1;
    direction[k] = up[k] * sinf(def->elevation_rad);
    direction[(k + 1) % 3] = cosf(def->elevation_rad) * cosf(def->azimuth_rad);
    direction[(k + 2) % 3] = cosf(def->elevation_rad) * sinf(def->azimuth_rad);
}

view_camera view_camera_fit(const view_camera_def *def, const view_surface *s, int width, int height) {
    view_camera c = {.fov_rad = 28 * PI / 180};
    float direction[3];
    eye_direction(def, direction, c.up);
    float low[3], high[3];
    memcpy(low, s->vertex_m, sizeof low);
    memcpy(high, s->vertex_m, sizeof high);
    for (int32_t i = 1; i < s->vertex_count; i++)
        for (int k = 0; k < 3; k++) {
            low[k] = fminf(low[k], s->vertex_m[3 * i + k]);
            high[k] = fmaxf(high[k], s->vertex_m[3 * i + k]);
        }
    for (int k = 0; k < 3; k++) c.middle_m[k] = c.at_m[k] = (low[k] + high[k]) / 2;
    c.floor_m = 0;
    for (int k = 0; k < 3; k++) c.floor_m += c.up[k] * (c.up[k] < 0 ? high : low)[k];
    c.radius_m = fmaxf(sqrtf((high[0] - low[0]) * (high[0] - low[0]) + (high[1] - low[1]) * (high[1] - low[1]) +
                             (high[2] - low[2]) * (high[2] - low[2])) /
                           2,
                       1e-4f);
    float tan_y = tanf(c.fov_rad / 2) * 0.72f, tan_x = tan_y * (float)width / (float)height, distance = 0;
    for (int k = 0; k < 3; k++) c.eye_m[k] = c.at_m[k] + direction[k];
    float right[3], up[3], back[3];
    eye_frame(&c, right, up, back);
    for (int32_t i = 0; i < s->vertex_count; i++) {
        float d[3];
        for (int k = 0; k < 3; k++) d[k] = s->vertex_m[3 * i + k] - c.at_m[k];
        distance = fmaxf(distance, vdot(d, back) + fmaxf(fabsf(vdot(d, right)) / tan_x, fabsf(vdot(d, up)) / tan_y));
    }
    distance = fmaxf(distance / fmaxf(def->zoom, 0.01f), 1e-4f);
    float height_m = 2 * distance * tanf(c.fov_rad / 2);
    for (int k = 0; k < 3; k++) {
        c.at_m[k] -= height_m * (def->shift[0] * right[k] + def->shift[1] * up[k]);
        c.eye_m[k] = c.at_m[k] + distance * back[k];
    }
    return c;
}

void view_camera_matrices(const view_camera *c, int width, int height, float view[16], float projection[16]) {
    float right[3], up[3], back[3];
    eye_frame(c, right, up, back);
    for (int k = 0; k < 3; k++)
        view[4 * k] = right[k], view[4 * k + 1] = up[k], view[4 * k + 2] = back[k], view[4 * k + 3] = 0;
    view[12] = -vdot(right, c->eye_m), view[13] = -vdot(up, c->eye_m), view[14] = -vdot(back, c->eye_m), view[15] = 1;
    float to[3] = {c->at_m[0] - c->eye_m[0], c->at_m[1] - c->eye_m[1], c->at_m[2] - c->eye_m[2]},
          distance = sqrtf(vdot(to, to));
    float near_m = distance * 0.02f, far_m = distance + 40 * c->radius_m, f = 1 / tanf(c->fov_rad / 2);
    memset(projection, 0, 16 * sizeof *projection);
    projection[0] = f * (float)height / (float)width;
    projection[5] = f;
    projection[10] = (far_m + near_m) / (near_m - far_m);
    projection[11] = -1;
    projection[14] = 2 * far_m * near_m / (near_m - far_m);
}

bool view_camera_project(const view_camera *c, int width, int height, const double point_m[3], float pixel[2]) {
    float right[3], up[3], back[3], d[3];
    eye_frame(c, right, up, back);
    for (int k = 0; k < 3; k++) d[k] = (float)point_m[k] - c->eye_m[k];
    float depth = -vdot(d, back);
    if (!(depth > 1e-6f)) return false;
    float f = (float)height / 2 / tanf(c->fov_rad / 2);
    pixel[0] = (float)width / 2 + f * vdot(d, right) / depth;
    pixel[1] = (float)height / 2 - f * vdot(d, up) / depth;
    return true;
}

int view_camera_facing(const view_camera *c, const double point_m[3], const double direction[3]) {
    static const double END_ON = 0.8660; /* cos 30 degrees */
    double along = 0, far2 = 0, size2 = 0;
    for (int k = 0; k < 3; k++) {
        double to_eye = (double)c->eye_m[k] - point_m[k];
        along += to_eye * direction[k], far2 += to_eye * to_eye, size2 += direction[k] * direction[k];
    }
    double cosine = along / sqrt(fmax(far2 * size2, 1e-30));
    return cosine > END_ON ? 1 : cosine < -END_ON ? -1 : 0;
}
