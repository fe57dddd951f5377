/* Requirements on every corotational law. */
#ifndef TM_TEST_TURNING_H
#define TM_TEST_TURNING_H

#include "../fixture.h"
#include "tissue/tangent.h"

/* Computes the complete force, linear and corotated parts. */
static inline void turning_force(const tm_tissue *tissue, const tm_rotation *rotation, const double *u, double *f,
                                 double *scratch) {
    tm_tissue_force(tissue, u, f);
    tm_rotation_force(rotation, u, scratch);
    for (int32_t i = 0; i < 3 * tissue->mesh->vertex_count; i++) f[i] += scratch[i];
}

static inline double turning_energy(const tm_tissue *tissue, const tm_rotation *rotation, const double *u) {
    return tm_tissue_energy(tissue, u) + tm_rotation_energy(rotation, u);
}

/* At `u`, the first of five vectors of which the third is a direction `d`: checks that the force is the energy's
 * derivative at ten components, and the tangent the force's along `d`. `near` and `near_tangent`: relative to the
 * largest entry. */
static inline void turning_has_derivatives(const tm_tissue *tissue, const tm_rotation *rotation, tm_tangent *tangent,
                                           double *u, fix_random *random, double near, double near_tangent) {
    const int32_t n = 3 * tissue->mesh->vertex_count;
    double *f = u + n, *d = u + 2 * n, *up = u + 3 * n, *s = u + 4 * n;
    turning_force(tissue, rotation, u, f, s);
    const double h = 1e-7, largest = fix_largest(f, n);
    for (int k = 0; k < 10; k++) {
        const int32_t i = (int32_t)(fix_uniform(random) * n);
        const double at = u[i];
        u[i] = at + h;
        const double more = turning_energy(tissue, rotation, u);
        u[i] = at - h;
        const double less = turning_energy(tissue, rotation, u);
        u[i] = at;
        assert_true(fabs((more - less) / (2 * h) + f[i]) < near * largest);
    }
    tm_rotation_tangent(rotation, u, tangent);
    for (int32_t i = 0; i < n; i++) u[i] += 0.1 * h * d[i];
    turning_force(tissue, rotation, u, up, s);
    for (int32_t i = 0; i < n; i++) u[i] -= 0.2 * h * d[i];
    turning_force(tissue, rotation, u, f, s);
    tm_force_pass(tangent->force, &tangent->graph, d, s);
    double worst = 0;
    for (int32_t i = 0; i < n; i++) worst = fmax(worst, fabs((up[i] - f[i]) / (0.2 * h) - s[i]));
    assert_true(worst < near_tangent * fix_largest(s, n));
}

#endif
