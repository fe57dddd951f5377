// Conjugate gradients with Eigen: the method of the paper for the responses.
#include "internal.h"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/Sparse>
#include <new>

using matrix = Eigen::SparseMatrix<double, Eigen::RowMajor>;

struct tms_cg {
    matrix full; // both triangles: a row-major product reads memory in order
    Eigen::DiagonalPreconditioner<double> jacobi;
};

tms_cg *tms_cg_create(const tms_system *s) try {
    const Eigen::Map<const Eigen::SparseMatrix<double>> lower(s->n, s->n, s->begin[s->n], s->begin, s->row, s->value);
    tms_cg *cg = new tms_cg;
    cg->full = lower.selfadjointView<Eigen::Lower>();
    cg->jacobi.compute(cg->full);
    return cg;
} catch (const std::bad_alloc &) {
    return nullptr;
}

void tms_cg_destroy(tms_cg *cg) { delete cg; }

bool tms_cg_solve(const tms_cg *cg, const double *b, double *x, double tolerance, int32_t max_iterations) try {
    const Eigen::Index n = cg->full.rows();
    const Eigen::Map<const Eigen::VectorXd> rhs(b, n);
    Eigen::Map<Eigen::VectorXd> out(x, n);
    out.setZero();
    if (rhs.squaredNorm() == 0) return true;
    Eigen::Index iterations = max_iterations;
    double error = tolerance;
    Eigen::internal::conjugate_gradient(cg->full, rhs, out, cg->jacobi, iterations, error);
    return error <= tolerance;
} catch (const std::bad_alloc &) {
    return false;
}
