/* The rows of corotated tissue. Tetrahedra beyond the threshold follow the linear law in axes that rotate with them
 * (corotated_kernel.h); the others follow the linear row, with a blend between. With averages, dilatations are those of
 * domains of vertices (nodal_dilatation.c). */
#include "base/vec.h"
#include "material/law.h"

static double energy(const tm_law_state *s, const double *u_m) {
    return tm_tet_batches_linear_energy(&s->batches, u_m) + tm_rotation_sum_energy(&s->batches, u_m);
}

static double averaged_energy(const tm_law_state *s, const double *u_m) {
    return energy(s, u_m) + tm_nodal_dilatation_total_energy(&s->averages, &s->batches, u_m);
}

static double product(const double A[9], const double B[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += A[i] * B[i];
    return sum;
}

static void add_product(const double A[81], const double D[9], double scale, double P[9]) {
    for (int i = 0; i < 9; i++) P[i] += scale * product(A + 9 * i, D);
}

/* Adds the change of stress of one tetrahedron's own law along D. */
static void add_own(const tm_law_state *s, int32_t tet, const double *u_m, const double D[9], double P[9]) {
    tm_corotated_lane lane;
    double A[81];
    const bool turned = tm_rotation_lane(&s->batches, tet, u_m, &lane);
    tm_rotation_lane_law(&s->batches, tet, &lane);
    tm_rotation_linear(&lane, A);
    add_product(A, D, 1, P);
    if (!turned) return;
    tm_rotation_hessian(&lane, A);
    add_product(A, D, 1, P);
}

static void tangent(const tm_law_state *s, const double *u_m, const double *d_m, double *change_N) {
    const tm_mesh *mesh = s->field.mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double D[9], P[9] = {0};
        if (!s->field.alive[t]) continue;
        tm_law_gradient(mesh, t, d_m, D);
        add_own(s, t, u_m, D, P);
        tm_law_add_stress(mesh, t, P, change_N);
    }
}

static void averaged_tangent(const tm_law_state *s, const double *u_m, const double *d_m, double *change_N) {
    const tm_mesh *mesh = s->field.mesh;
    const tm_nodal_dilatation *a = &s->averages;
    tm_nodal_dilatation_evaluate(a, &s->batches, true, u_m);
    tm_law_change_pressures(s, d_m);
    tangent(s, u_m, d_m, change_N);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double D[9], H[9], R[9], A[81], P[9] = {0}, pressure = 0, change = 0;
        if (!s->field.alive[t]) continue;
        for (int k = 0; k < 4; k++) {
            pressure += a->corotated_Pa[a->domain[4 * (int64_t)t + k]];
            change += a->linear_Pa[a->domain[4 * (int64_t)t + k]];
        }
        tm_law_gradient(mesh, t, d_m, D);
        tm_law_gradient(mesh, t, u_m, H);
        tm_law_slope(a, t, R);
        tm_stretch_hessian(H, R, a->dilatation[t] / a->quarter_m3[t] + 3, A);
        add_product(A, D, a->quarter_m3[t] * pressure, P);
        for (int i = 0; i < 9; i++) P[i] += a->quarter_m3[t] * change * R[i];
        tm_law_add_stress(mesh, t, P, change_N);
    }
}

const tm_law tm_law_corotated = {.name = "rotation",
                                 .is_objective = true,
                                 .energy = energy,
                                 .force = tm_law_batch_force,
                                 .tangent = tangent,
                                 .bound = tm_corotated_eigenvalue_over};

const tm_law tm_law_corotated_averaged = {.name = "rotation and volume",
                                          .is_objective = true,
                                          .averages = true,
                                          .energy = averaged_energy,
                                          .force = tm_law_batch_force,
                                          .tangent = averaged_tangent,
                                          .bound = tm_corotated_eigenvalue_over};
