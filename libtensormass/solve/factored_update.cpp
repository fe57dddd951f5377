// Effect of a cut on a compliance whose factor does not include it yet: Woodbury's identity on the touched components.
#define EIGEN_USE_BLAS
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

// D B; skips zeros, since distant vertices have no entry in D.
static matrix cut_times(const view &D, const matrix &B) {
    matrix out = matrix::Zero(D.rows(), B.cols());
    for (Eigen::Index i = 0; i < D.rows(); i++)
        for (Eigen::Index k = 0; k < D.cols(); k++)
            if (D(i, k) != 0) out.row(i) += D(i, k) * B.row(k);
    return out;
}

bool tms_update_middle(const double *G, int32_t size, const int32_t *touched, int32_t t, const double *D, double *M,
                       int32_t *pivot) try {
    Eigen::Map<matrix> middle(M, t, t);
    middle = -cut_times(view(D, t, t), gather(view(G, size, size), touched, t, touched, t));
    middle.diagonal().array() += 1;
    const Eigen::PartialPivLU<Eigen::Ref<matrix>> lu(middle); // in place
    for (int32_t i = 0; i < t; i++) pivot[i] = int32_t(lu.permutationP().indices()(i));
    return middle.allFinite();
} catch (const std::bad_alloc &) {
    return false;
}

bool tms_update_columns(const double *G, int32_t size, const int32_t *column, int32_t count, const int32_t *touched,
                        int32_t t, const double *D, const double *M, const int32_t *pivot, double *X) try {
    const view lu(M, t, t);
    const matrix right = cut_times(view(D, t, t), gather(view(G, size, size), touched, t, column, count));
    matrix x(t, count);
    for (int32_t i = 0; i < t; i++) x.row(pivot[i]) = right.row(i);
    lu.triangularView<Eigen::UnitLower>().solveInPlace(x);
    lu.triangularView<Eigen::Upper>().solveInPlace(x);
    for (int32_t j = 0; j < count; j++)
        for (int32_t i = 0; i < t; i++) X[int64_t(column[j]) * t + i] = x(i, j);
    return true;
} catch (const std::bad_alloc &) {
    return false;
}

bool tms_update_result(const double *G, int32_t size, const int32_t *wanted, int32_t w, const int32_t *touched,
                       int32_t t, const double *X, double *C) try {
    const view all(G, size, size);
    Eigen::Map<matrix> out(C, w, w);
    out = gather(all, wanted, w, wanted, w);
    if (t > 0) {
        matrix x(w, t);
        for (int32_t i = 0; i < w; i++) x.row(i) = view(X + int64_t(wanted[i]) * t, 1, t);
        out.noalias() += gather(all, wanted, w, touched, t) * x.transpose();
    }
    out = matrix(0.5 * (out + out.transpose()));
    return out.allFinite();
} catch (const std::bad_alloc &) {
    return false;
}
