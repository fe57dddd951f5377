/* A patch of bumpy elastic ground under a tool, for the tests of `local_model`. */
#ifndef GROUND_PATCH_H
#define GROUND_PATCH_H

#include "../fixture.h"
#include "internal.h"
#include "rig.h"

enum { SIDE = 5, VERTICES = 24, TRIANGLES = 32 };

static hrt_params params;
static hrt_patch patch;
static float scratch[HRT_PATCH_COMPLIANCE];

static inline int packed(int n, int i, int j) { return i * (2 * n - i - 1) / 2 + j; }

/* Makes bumpy ground of 5 x 5 vertices less a corner, at depth z0 under the trocar, normals up to it. */
static inline void make_ground(hrt_patch *p, uint64_t *seed, float spacing, float bump, float z0) {
    memset(p, 0, sizeof *p);
    p->vertex_count = VERTICES;
    for (int v = 0; v < VERTICES; v++) {
        p->vertex_m[3 * v] = spacing * ((float)(v % SIDE) - 2.0f) + rig_uniform(seed, -0.15f, 0.15f) * spacing;
        p->vertex_m[3 * v + 1] = spacing * ((float)(v / SIDE) - 2.0f) + rig_uniform(seed, -0.15f, 0.15f) * spacing;
        p->vertex_m[3 * v + 2] = z0 + rig_uniform(seed, -bump, bump);
    }
    for (int x = 0; x < SIDE - 1; x++)
        for (int y = 0; y < SIDE - 1; y++) {
            const uint8_t a = (uint8_t)(x + SIDE * y), b = (uint8_t)(a + 1), c = (uint8_t)(a + SIDE),
                          d = (uint8_t)(c + 1);
            const uint8_t corner[6] = {a, c, b, b, c, d};
            for (int t = 0; t < 2; t++)
                if (corner[3 * t] < VERTICES && corner[3 * t + 1] < VERTICES && corner[3 * t + 2] < VERTICES)
                    memcpy(&p->triangle[3 * p->triangle_count++], &corner[3 * t], 3);
        }
    /* Fills the compliance of elastic ground with a decaying kernel: positive definite. */
    for (int i = 0; i < 3 * VERTICES; i++)
        for (int j = i; j < 3 * VERTICES; j++) {
            float apart[3];
            for (int c = 0; c < 3; c++) apart[c] = p->vertex_m[3 * (i / 3) + c] - p->vertex_m[3 * (j / 3) + c];
            const float far = sqrtf(apart[0] * apart[0] + apart[1] * apart[1]);
            p->compliance_m_N[packed(3 * VERTICES, i, j)] =
                i % 3 == j % 3 ? 0.003f * expf(-far / (2.0f * spacing)) : 0.0f;
        }
    p->contact_compliance_m_N = 0.0005f;
    p->radius_m = 0.0025f;
    p->contact_length_m = 0.08f;
}

static inline int set_up(void **state) {
    (void)state;
    hrt_params_default(&params);
    return 0;
}

static inline void ground(float bump) {
    uint64_t seed = 9;
    make_ground(&patch, &seed, 0.004f, bump, 0.12f);
    assert_int_equal(hrt_patch_prepare(&patch, scratch), HRT_ACCEPT);
}

static inline float size_of(const float a[3]) { return sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

static inline void take(hrt_extrapolation *x, int64_t t_us, const float tip[3], const hrt_patch *p, uint32_t seq) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = t_us, .seq = seq, .unilateral = true, .patch = p};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    hrt_extrapolation_sample(x, &params, &s);
}

static inline void take_grasper(hrt_extrapolation *x, int64_t t_us, const float tip[3], const hrt_patch *p,
                                uint32_t seq) {
    hrt_sample s = {.session = SIM, .tool_session = SESSION, .t_us = t_us, .seq = seq, .patch = p};
    memcpy(s.tip_m, tip, sizeof s.tip_m);
    hrt_extrapolation_sample(x, &params, &s);
}

static inline void settle(hrt_extrapolation *x, const float tip[3], float force[3]) {
    for (int k = 0; k < 60; k++) hrt_extrapolation_force(x, &params, 0, tip, force);
}

#endif
