// What a cut does to a compliance whose factor knows nothing of it yet: Woodbury's identity on the touched components.
#include "factored.h"

#include <Eigen/Dense>
#include <new>

using matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using view = Eigen::Map<const matrix>;

static matrix gather(const view &G, const int32_t *row, int32_t rows, const int32_t *column, int32_t columns) {
    matrix out(rows, columns);
    for (int32_t i = 0; i < rows; i++)
        for (int32_t j = 0; j < columns; j++) out(i, j) = G(row[i], column[j]);
    return out;
}

bool tms_update_middle(const double *G, int32_t size, const int32_t *touched, int32_t t, const double *D,
                       double *M) try {
    const view all(G, size, size), cut(D, t, t);
    // (I - G D)^T M^T = D^T, and both G and D are symmetric.
    const matrix left = matrix::Identity(t, t) - cut * gather(all, touched, t, touched, t);
    Eigen::Map<matrix> middle(M, t, t);
    middle = left.partialPivLu().solve(matrix(cut));
    middle = matrix(0.5 * (middle + middle.transpose()));
    return middle.allFinite();
} catch (const std::bad_alloc &) {
    return false;
}

bool tms_update_piece(const double *G, int32_t size, const int32_t *wanted, int32_t w, const int32_t *touched,
                      int32_t t, const double *M, double *C) try {
    const view all(G, size, size);
    Eigen::Map<matrix> out(C, w, w);
    out = gather(all, wanted, w, wanted, w);
    if (t > 0) {
        const matrix Z = gather(all, wanted, w, touched, t);
        out += Z * (view(M, t, t) * Z.transpose());
    }
    out = matrix(0.5 * (out + out.transpose()));
    return out.allFinite();
} catch (const std::bad_alloc &) {
    return false;
}
