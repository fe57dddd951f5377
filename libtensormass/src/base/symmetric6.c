/* Eigenvalues of small symmetric matrices. */
#include "base/base_internal.h"

void tm_diagonalise6(double A[36]) {
    for (int sweep = 0; sweep < 30; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < 36; i++) *(i % 7 ? &off : &diagonal) += A[i] * A[i];
        if (off <= 1e-30 * diagonal) break;
        for (int p = 0; p < 5; p++)
            for (int q = p + 1; q < 6; q++) tm_jacobi(A, 6, p, q, &(double){0}, &(double){0});
    }
}
