// Columns of a compliance among few components. Solves only with the supernodes on the paths from these to the root of
// the elimination tree, forward and back; the rest of the factor has no influence.
#define EIGEN_USE_BLAS
#include "internal.h"

#include <algorithm>
#include <Eigen/Dense>

using matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>;
using strided = Eigen::OuterStride<>;
using view = Eigen::Map<const matrix, 0, strided>;
using block = Eigen::Map<matrix, 0, strided>;

struct tms_reach {
    int32_t n, supernodes, most; // most: maximum rows of a supernode
    int32_t *place, *of;         // place: position of each component in the factor; of: supernode of a position
    uint8_t *forward, *back;     // supernodes to process
    double *x, *below;           // [n][TMS_BLOCK] and [most][TMS_BLOCK], column after column
};

static bool take(tms_reach *r) {
    const size_t n = size_t(r->n), count = size_t(r->supernodes);
    r->place = static_cast<int32_t *>(tms_alloc(4 * n));
    r->of = static_cast<int32_t *>(tms_alloc(4 * n));
    r->forward = static_cast<uint8_t *>(tms_alloc(count));
    r->back = static_cast<uint8_t *>(tms_alloc(count));
    r->x = static_cast<double *>(tms_alloc(8 * n * TMS_BLOCK));
    r->below = static_cast<double *>(tms_alloc(8 * size_t(r->most) * TMS_BLOCK));
    return r->place && r->of && r->forward && r->back && r->x && r->below;
}

tms_reach *tms_reach_create(const tms_solver *solver) {
    const tms_supernodes f = tms_solver_supernodes(solver);
    tms_reach *r = f.x ? static_cast<tms_reach *>(tms_alloc_zeroed(1, sizeof *r)) : nullptr;
    if (!r) return nullptr;
    r->n = f.n;
    r->supernodes = f.count;
    for (int32_t s = 0; s < f.count; s++) r->most = std::max(r->most, f.row_begin[s + 1] - f.row_begin[s]);
    if (!take(r)) {
        tms_reach_destroy(r);
        return nullptr;
    }
    for (int32_t k = 0; k < f.n; k++) r->place[f.component[k]] = k;
    for (int32_t s = 0; s < f.count; s++)
        for (int32_t k = f.begin[s]; k < f.begin[s + 1]; k++) r->of[k] = s;
    return r;
}

void tms_reach_destroy(tms_reach *r) {
    if (!r) return;
    tms_free(r->place);
    tms_free(r->of);
    tms_free(r->forward);
    tms_free(r->back);
    tms_free(r->x);
    tms_free(r->below);
    tms_free(r);
}

int64_t tms_reach_bytes(const tms_reach *r) {
    return 8 * int64_t(r->n) + 2 * int64_t(r->supernodes) + 8 * TMS_BLOCK * (int64_t(r->n) + r->most);
}

// Marks the supernodes from a component's to the root; above a marked one all are marked.
static void climb(const tms_reach *r, const tms_supernodes &f, int32_t component, uint8_t *marked) {
    int32_t s = component < 0 ? -1 : r->of[r->place[component]];
    while (s >= 0 && !marked[s]) {
        marked[s] = 1;
        const int32_t own = f.begin[s + 1] - f.begin[s], next = f.row_begin[s] + own;
        s = next < f.row_begin[s + 1] ? r->of[f.row[next]] : -1;
    }
}

// One supernode: its columns, with its own rows first, and the rows below.
struct supernode {
    int32_t first, own, rows;
    const int32_t *below;
    view diagonal, rest;
    supernode(const tms_supernodes &f, int32_t s)
        : first(f.begin[s]), own(f.begin[s + 1] - first), rows(f.row_begin[s + 1] - f.row_begin[s] - own),
          below(f.row + f.row_begin[s] + own), diagonal(f.x + f.x_begin[s], own, own, strided(own + rows)),
          rest(f.x + f.x_begin[s] + own, rows, own, strided(own + rows)) {}
};

static void solve_forward(tms_reach *r, const tms_supernodes &f, int32_t columns) {
    for (int32_t s = 0; s < f.count; s++) {
        if (!r->forward[s]) continue;
        const supernode n(f, s);
        block own(r->x + n.first, n.own, columns, strided(f.n));
        block below(r->below, n.rows, columns, strided(n.rows));
        n.diagonal.triangularView<Eigen::Lower>().solveInPlace(own);
        if (!n.rows) continue;
        below.noalias() = n.rest * own;
        for (int32_t j = 0; j < columns; j++)
            for (int32_t i = 0; i < n.rows; i++) r->x[int64_t(j) * f.n + n.below[i]] -= below(i, j);
    }
}

static void solve_back(tms_reach *r, const tms_supernodes &f, int32_t columns) {
    for (int32_t s = f.count - 1; s >= 0; s--) {
        if (!r->back[s]) continue;
        const supernode n(f, s);
        block own(r->x + n.first, n.own, columns, strided(f.n));
        block below(r->below, n.rows, columns, strided(n.rows));
        for (int32_t j = 0; j < columns; j++)
            for (int32_t i = 0; i < n.rows; i++) below(i, j) = r->x[int64_t(j) * f.n + n.below[i]];
        if (n.rows) own.noalias() -= n.rest.transpose() * below;
        n.diagonal.triangularView<Eigen::Lower>().transpose().solveInPlace(own);
    }
}

void tms_reach_solve(tms_reach *r, const tms_solver *solver, const int32_t *unit, int32_t units, const int32_t *row,
                     int32_t rows, double *out) {
    const tms_supernodes f = tms_solver_supernodes(solver);
    std::fill_n(r->forward, f.count, uint8_t(0));
    for (int32_t j = 0; j < units; j++) climb(r, f, unit[j], r->forward);
    std::copy_n(r->forward, f.count, r->back); // a row needs those on its path to the root: solved forward, or zero
    for (int32_t i = 0; i < rows; i++) climb(r, f, row[i], r->back);
    for (int32_t s = 0; s < f.count; s++)
        for (int32_t j = 0; r->back[s] && j < units; j++)
            std::fill(r->x + int64_t(j) * f.n + f.begin[s], r->x + int64_t(j) * f.n + f.begin[s + 1], 0.0);
    for (int32_t j = 0; j < units; j++)
        if (unit[j] >= 0) r->x[int64_t(j) * f.n + r->place[unit[j]]] = 1;
    tms_process_enter();
    solve_forward(r, f, units);
    solve_back(r, f, units);
    tms_process_leave();
    for (int32_t j = 0; j < units; j++)
        for (int32_t i = 0; i < rows; i++)
            out[int64_t(i) * units + j] = row[i] < 0 ? 0 : r->x[int64_t(j) * f.n + r->place[row[i]]];
}
