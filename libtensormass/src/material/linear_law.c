/* The row of linear tissue: w = E.C E/2 of E = sym grad u. Its tangent is constant: stiffness tensors (material.c) are
 * summed once, and a step computes with them. */
#include "material/law.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* --- energy, force, tangent --- */

static double energy(const tm_law_state *s, const double *u_m) {
    return tm_tet_batches_linear_energy(&s->batches, u_m);
}

static void tangent(const tm_law_state *s, const double *u_m, const double *d_m, double *change_N) {
    const tm_mesh *mesh = s->field.mesh;
    (void)u_m;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        tm_corotated_lane lane;
        double A[81], D[9], P[9] = {0};
        if (!s->field.alive[t]) continue;
        tm_law_gradient(mesh, t, d_m, D);
        tm_rotation_lane_law(&s->batches, t, &lane);
        tm_rotation_linear(&lane, A);
        for (int i = 0; i < 81; i++) P[i / 9] += A[i] * D[i % 9];
        tm_law_add_stress(mesh, t, P, change_N);
    }
}

/* --- the bound: at most 0.2 % too large --- */

/* Cholesky factor of the 6x6 elasticity matrix (Voigt) in Mandel form (lower, row-major). */
static void factor_elasticity(const double law_Pa[36], double L[36]) {
    double C[36];
    memcpy(C, law_Pa, sizeof C);
    for (int i = 0; i < 36; i++) C[i] *= (i / 6 > 2 ? sqrt(2.0) : 1) * (i % 6 > 2 ? sqrt(2.0) : 1);
    memset(L, 0, 36 * sizeof(double));
    for (int j = 0; j < 6; j++) {
        double d = C[7 * j];
        for (int k = 0; k < j; k++) d -= L[6 * j + k] * L[6 * j + k];
        const double root = sqrt(fmax(d, 0));
        L[7 * j] = root;
        for (int i = j + 1; i < 6; i++) {
            double s = C[6 * i + j];
            for (int k = 0; k < j; k++) s -= L[6 * i + k] * L[6 * j + k];
            L[6 * i + j] = root > 0 ? s / root : 0;
        }
    }
}

void tm_strain_gram_add(const double alpha[3], double scale, double G[36]) {
    const double h = sqrt(0.5), x = alpha[0], y = alpha[1], z = alpha[2];
    const double B[6][3] = {{x, 0, 0}, {0, y, 0}, {0, 0, z}, {0, h * z, h * y}, {h * z, 0, h * x}, {h * y, h * x, 0}};
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) G[6 * i + j] += scale * vdot(B[i], B[j]);
}

/* sum_k scale_k B_k B_k^T: B_k maps a vertex displacement to the strain in Mandel form. */
static void strain_gram(const double alpha[12], const double scale[4], double G[36]) {
    memset(G, 0, 36 * sizeof(double));
    for (int k = 0; k < 4; k++) tm_strain_gram_add(alpha + 3 * k, scale[k], G);
}

/* A = L^T G L with C = L L^T: its eigenvalues are those of G C. */
static void law_gram(const double law_Pa[36], const double G[36], double A[36]) {
    double L[36], GL[36];
    factor_elasticity(law_Pa, L);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            GL[6 * i + j] = 0;
            for (int k = j; k < 6; k++) GL[6 * i + j] += G[6 * i + k] * L[6 * k + j];
        }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            A[6 * i + j] = 0;
            for (int k = i; k < 6; k++) A[6 * i + j] += L[6 * k + i] * GL[6 * k + j];
        }
}

/* The elasticity of a tetrahedron, or a bound of it under any smoothing. */
void tm_linear_gram(const tm_material_field *field, int32_t tet, const double G[36], double A[36]) {
    double law_Pa[36];
    tm_material cover;
    const tm_material *above = field->smoothed ? tm_smoothed_cover(field, tet, &cover) : NULL;
    tm_material_voigt(above ? above : tm_field_material(field, tet), above ? NULL : tm_field_fibre(field, tet), law_Pa);
    law_gram(law_Pa, G, A);
}

/* Returns an upper bound of the largest eigenvalue of a semidefinite A: the root of the trace of A^(2^k). Squaring
 * costs a fifth of Jacobi rotations. After ten squarings the value is less than 0.2 % too large, even if all
 * eigenvalues are equal. */
static double largest_from_above(double A[36]) {
    double trace[11], P[36];
    int squares = 0;
    for (;;) {
        trace[squares] = 0;
        for (int i = 0; i < 6; i++) trace[squares] += A[7 * i];
        if (!(trace[squares] > 0)) return 0;
        if (squares == 10 || (squares > 0 && trace[squares] > 1 - 1e-13)) break;
        for (int i = 0; i < 36; i++) P[i] = A[i] / trace[squares];
        for (int i = 0; i < 6; i++)
            for (int j = 0; j <= i; j++) {
                A[6 * i + j] = 0;
                for (int k = 0; k < 6; k++) A[6 * i + j] += P[6 * i + k] * P[6 * j + k];
                A[6 * j + i] = A[6 * i + j];
            }
        squares++;
    }
    double root = 1;
    for (; squares > 0; squares--) root = sqrt(trace[squares] * root);
    return trace[0] * root;
}

double tm_law_eigenvalue_over(const double law_Pa[36], const double G[36]) {
    double A[36];
    law_gram(law_Pa, G, A);
    return largest_from_above(A);
}

static double bound(const tm_material_field *field, int32_t tet, const double mass_kg[4]) {
    double scale[4], G[36], A[36];
    for (int k = 0; k < 4; k++) scale[k] = field->mesh->volume_m3[tet] / mass_kg[k];
    strain_gram(field->mesh->shape_1_m + 12 * (int64_t)tet, scale, G);
    tm_linear_gram(field, tet, G, A);
    return largest_from_above(A);
}

const tm_law tm_law_linear = {.name = "linear",
                              .has_constant_tangent = true,
                              .energy = energy,
                              .force = tm_law_batch_force,
                              .tangent = tangent,
                              .bound = bound};
