/* Critical time steps: the guaranteed bound by elements (Irons; with weights in critical_step_weighted.c), and the
 * estimated step of the assembled system. */
#include "libtensormass/numeric/random.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "material/law.h"
#include "tissue/strain_smoothing_pairs.h"
#include "tissue/tissue_internal.h"

/* Covers rounding of the assembled tensors, single ones above all. */
double tm_critical_margin(const tm_tissue *tissue) {
    return tissue->precision == TM_SINGLE || tissue->has_single_law ? 1e-5 : 1e-12;
}

static double step_of(const tm_tissue *tissue, double eigenvalue) {
    return 2 / sqrt(eigenvalue * (1 + tm_critical_margin(tissue)));
}

double tm_critical_step_element(const tm_tissue *tissue, int32_t tet) {
    TM_REQUIRE(tissue && tet >= 0 && tet < tissue->mesh->tet_count,
               "tissue is null or tet is not one of its tetrahedra", 0);
    return step_of(tissue, tm_element_eigenvalue(tissue, tet));
}

bool tm_critical_step_find(const tm_tissue *tissue, double *step_s, int32_t *tet) {
    const tm_material_field field = tm_tissue_field(tissue);
    double most = 0;
    int32_t worst = -1;
    for (int32_t t = 0; t < tissue->mesh->tet_count; t++) {
        if (!tissue->alive[t]) continue;
        const double e = tm_element_eigenvalue_above(tissue, t, most);
        if (e > most) {
            most = e;
            worst = t;
        }
    }
    /* Stability of the condensed part depends on the extra masses. */
    const bool even = tissue->cuttable || tissue->extra_mass_kg || tissue->required_mass_kg || worst < 0;
    const bool done = even || (tissue->smoothed && tm_law_of(&field)->has_constant_tangent
                                   ? tm_smoothed_eigenvalue(tissue, &most, &worst)
                                   : tm_shared_eigenvalue(tissue, &most, &worst));
    *tet = worst;
    *step_s = worst < 0 ? HUGE_VAL : step_of(tissue, most);
    if (tissue->required_mass_kg && *step_s < tissue->scaled_step_s) *step_s = tissue->scaled_step_s;
    return done;
}

double tm_critical_step_guaranteed(const tm_tissue *tissue, int32_t *tet) {
    int32_t worst;
    double step_s;
    tm_critical_step_find(tissue, &step_s, &worst);
    if (tet) *tet = worst;
    return step_s;
}

/* --- estimated step --- */

/* Power iteration for A = M^-1/2 K M^-1/2, accelerated by Rayleigh-Ritz over {x, residual, last direction} at each
 * step. */
typedef struct iteration {
    tm_pool pool;
    const tm_tissue *tissue;
    int64_t n;
    double *scale;               /* [n] 1/sqrt(m), 0 where fixed or without mass */
    double *basis[3], *image[3]; /* x, r, p and A times them */
    double *work;
} iteration;

static void apply(iteration *it, const double *x, double *y) {
    for (int64_t i = 0; i < it->n; i++) it->work[i] = x[i] * it->scale[i];
    tm_tissue_force(it->tissue, it->work, y);
    for (int64_t i = 0; i < it->n; i++) y[i] = -y[i] * it->scale[i];
}

static double product(const iteration *it, const double *a, const double *b) {
    double sum = 0;
    for (int64_t i = 0; i < it->n; i++) sum += a[i] * b[i];
    return sum;
}

/* Makes basis[k] orthogonal to the earlier ones and of unit length, twice against rounding; returns false if nothing is
 * left. With `follow`, transforms `image` too. */
static bool orthonormalise(iteration *it, int k, bool follow) {
    const double before = sqrt(product(it, it->basis[k], it->basis[k]));
    if (!(before > DBL_MIN)) return false;
    for (int pass = 0; pass < 2; pass++)
        for (int j = 0; j < k; j++) {
            const double c = product(it, it->basis[j], it->basis[k]);
            for (int64_t i = 0; i < it->n; i++) {
                it->basis[k][i] -= c * it->basis[j][i];
                if (follow) it->image[k][i] -= c * it->image[j][i];
            }
        }
    const double left = sqrt(product(it, it->basis[k], it->basis[k]));
    if (!(left > 1e-9 * before)) return false;
    for (int64_t i = 0; i < it->n; i++) {
        it->basis[k][i] /= left;
        if (follow) it->image[k][i] /= left;
    }
    return true;
}

/* Eigenvector of the largest eigenvalue of a symmetric m x m matrix, m <= 3, by Jacobi. */
static void top_vector(double A[9], int m, double v[3]) {
    double V[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int sweep = 0; sweep < 40; sweep++)
        for (int p = 0; p < m - 1; p++)
            for (int q = p + 1; q < m; q++) {
                double c, s;
                tm_jacobi(A, 3, p, q, &c, &s);
                for (int k = 0; k < 3; k++) {
                    const double x = V[3 * k + p], y = V[3 * k + q];
                    V[3 * k + p] = c * x - s * y;
                    V[3 * k + q] = s * x + c * y;
                }
            }
    int best = 0;
    for (int i = 1; i < m; i++)
        if (A[4 * i] > A[4 * best]) best = i;
    for (int i = 0; i < 3; i++) v[i] = i < m ? V[3 * i + best] : 0;
}

/* Replaces x by the best combination of the first m basis vectors, and stores its increment as direction. */
static void combine(iteration *it, int m) {
    double A[9] = {0}, v[3];
    for (int i = 0; i < m; i++)
        for (int j = 0; j < m; j++) A[3 * i + j] = product(it, it->basis[i], it->image[j]);
    for (int i = 0; i < m; i++)
        for (int j = 0; j < i; j++) A[3 * i + j] = A[3 * j + i];
    top_vector(A, m, v);
    for (int64_t i = 0; i < it->n; i++) {
        double move = 0, image = 0;
        for (int j = 1; j < m; j++) {
            move += v[j] * it->basis[j][i];
            image += v[j] * it->image[j][i];
        }
        it->basis[0][i] = v[0] * it->basis[0][i] + move;
        it->image[0][i] = v[0] * it->image[0][i] + image;
        it->basis[2][i] = move;
        it->image[2][i] = image;
    }
}

static bool take_iteration(iteration *it, const tm_tissue *tissue, const uint8_t *fixed) {
    it->tissue = tissue;
    it->n = 3 * (int64_t)tissue->mesh->vertex_count;
    it->scale = TM_ALLOC(&it->pool, double, it->n);
    it->work = TM_ALLOC(&it->pool, double, it->n);
    for (int j = 0; j < 3; j++) {
        it->basis[j] = TM_ALLOC(&it->pool, double, it->n);
        it->image[j] = TM_ALLOC(&it->pool, double, it->n);
    }
    if (it->pool.failed) return false;
    uint64_t noise = 0x9e3779b97f4a7c15ULL;
    for (int64_t i = 0; i < it->n; i++) {
        const double mass = tissue->mass_kg[i / 3];
        it->scale[i] = mass > 0 && !(fixed && fixed[i]) ? 1 / sqrt(mass) : 0;
        const uint64_t bits = num_xorshift64(&noise);
        it->basis[0][i] = it->scale[i] > 0 ? num_unit(bits) - 0.5 : 0;
    }
    return true;
}

static tm_status iterate(iteration *it, double tolerance, int32_t max_iterations, double *eigenvalue, tm_error *error) {
    double value = 0, residual = 1;
    bool direction = false;
    for (int32_t step = 0; step < max_iterations; step++) {
        if (!orthonormalise(it, 0, false)) break;
        apply(it, it->basis[0], it->image[0]);
        value = product(it, it->basis[0], it->image[0]);
        for (int64_t i = 0; i < it->n; i++) it->basis[1][i] = it->image[0][i] - value * it->basis[0][i];
        residual = sqrt(product(it, it->basis[1], it->basis[1])) / (value > 0 ? value : 1);
        *eigenvalue = value;
        if (residual <= tolerance) return TM_OK;
        int m = 1;
        if (orthonormalise(it, 1, false)) {
            apply(it, it->basis[1], it->image[1]);
            m = 2;
            if (direction && orthonormalise(it, 2, true)) m = 3;
        }
        combine(it, m);
        direction = m > 1;
    }
    return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                   "the largest eigenvalue has a residual of %g after %d iterations, not %g; allow "
                   "more iterations or a larger tolerance",
                   residual, max_iterations, tolerance);
}

tm_status tm_critical_step_estimate(const tm_tissue *tissue, const uint8_t *fixed, double tolerance,
                                    int32_t max_iterations, double *step_s, tm_error *error) {
    TM_REQUIRE(tissue && step_s, "tissue or step_s is null", TM_ERR_ARGUMENT);
    if (!(tolerance > 0) || max_iterations < 1)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "tolerance %g and %d iterations; give positive numbers", tolerance,
                       max_iterations);
    iteration it = {0};
    if (!take_iteration(&it, tissue, fixed)) {
        tm_pool_release(&it.pool);
        return tm_fail_memory(error, "eigenvalue iteration");
    }
    double eigenvalue = 0;
    tm_status status = TM_OK;
    if (product(&it, it.basis[0], it.basis[0]) > 0)
        status = iterate(&it, tolerance, max_iterations, &eigenvalue, error);
    tm_pool_release(&it.pool);
    if (!status) *step_s = eigenvalue > 0 ? 2 / sqrt(eigenvalue) : HUGE_VAL;
    return status;
}
