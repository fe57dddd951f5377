/* Eigenvalues of small symmetric matrices. */
#include "base/base_internal.h"

void tm_diagonalise6(double A[36]) {
    for (int sweep = 0; sweep < 30; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < 36; i++) *(i % 7 ? &off : &diagonal) += A[i] * A[i];
        if (off <= 1e-30 * diagonal) break;
        for (int p = 0; p < 5; p++)
            for (int q = p + 1; q < 6; q++) {
                if (A[6 * p + q] == 0) continue;
                const double theta = (A[7 * q] - A[7 * p]) / (2 * A[6 * p + q]);
                const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 6; k++) {
                    const double a = A[6 * k + p], b = A[6 * k + q];
                    A[6 * k + p] = c * a - s * b;
                    A[6 * k + q] = s * a + c * b;
                }
                for (int k = 0; k < 6; k++) {
                    const double a = A[6 * p + k], b = A[6 * q + k];
                    A[6 * p + k] = c * a - s * b;
                    A[6 * q + k] = s * a + c * b;
                }
            }
    }
}
