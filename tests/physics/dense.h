/* Dense matrices from a tissue's force, and their eigenvalues: references for bounds and modes in short tests. */
#ifndef TM_TEST_DENSE_H
#define TM_TEST_DENSE_H

#include "../fixture.h"

/* Leaves the eigenvalues of the symmetric A[n*n] on its diagonal, by Jacobi rotations. */
static inline void dense_diagonalise(double *A, int n) {
    for (int sweep = 0; sweep < 50; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < n * n; i++) *(i % (n + 1) ? &off : &diagonal) += A[i] * A[i];
        if (off <= 1e-22 * diagonal) break;
        for (int p = 0; p < n - 1; p++)
            for (int q = p + 1; q < n; q++) {
                if (fabs(A[p * n + q]) <= 1e-14 * sqrt(diagonal) / n) continue;
                const double theta = (A[q * n + q] - A[p * n + p]) / (2 * A[p * n + q]);
                const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < n; k++) {
                    const double a = A[k * n + p], b = A[k * n + q];
                    A[k * n + p] = c * a - s * b, A[k * n + q] = s * a + c * b;
                }
                for (int k = 0; k < n; k++) {
                    const double a = A[p * n + k], b = A[q * n + k];
                    A[p * n + k] = c * a - s * b, A[q * n + k] = s * a + c * b;
                }
            }
    }
}

static inline double dense_largest(double *A, int n) {
    double most = 0;
    dense_diagonalise(A, n);
    for (int i = 0; i < n; i++) most = fmax(most, A[i * (n + 1)]);
    return most;
}

/* Computes M^-1/2 K M^-1/2 of the stored tissue from columns of the force; rows without mass are 0. Free it. */
static inline double *dense_matrix(const tm_tissue *tissue) {
    const int n = 3 * tm_tissue_mesh(tissue)->vertex_count;
    const double *mass = tm_tissue_mass_kg(tissue);
    double *u = calloc((size_t)n, sizeof *u), *f = malloc(sizeof *f * (size_t)n),
           *A = calloc((size_t)(n * n), sizeof *A);
    for (int j = 0; j < n; j++) {
        u[j] = 1;
        tm_tissue_force(tissue, u, f);
        u[j] = 0;
        for (int i = 0; i < n; i++)
            if (mass[i / 3] > 0 && mass[j / 3] > 0) A[i * n + j] = -f[i] / sqrt(mass[i / 3] * mass[j / 3]);
    }
    free(u), free(f);
    return A;
}

/* Returns 2/omega_max of the stored tissue. */
static inline double dense_step(const tm_tissue *tissue) {
    double *A = dense_matrix(tissue);
    const double step = 2 / sqrt(dense_largest(A, 3 * tm_tissue_mesh(tissue)->vertex_count));
    free(A);
    return step;
}

#endif
