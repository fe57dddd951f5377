/* Critical time steps: the guaranteed element bound (Irons; shared anew in critical_shared.c) and the sharp figure of
 * the assembled system. */
#include "tissue/smoothed.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* --- element bound --- */

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

/* The law of a tetrahedron, or what bounds all that smoothing can make of it. */
static void material_gram(const tm_tissue *tissue, int32_t tet, const double G[36], double A[36]) {
    double law_Pa[36];
    tm_material cover;
    const tm_material *above = tissue->smoothed ? tm_smoothed_cover(tissue, tet, &cover) : NULL;
    tm_material_voigt(above ? above : tm_tissue_tet_material(tissue, tet),
                      above ? NULL : tm_tissue_tet_fibre(tissue, tet), law_Pa);
    law_gram(law_Pa, G, A);
}

/* K_e = V B^T C B and M_e = rho V/4: the eigenvalues are 4/rho times those of L^T (B B^T) L, C = L L^T.
 * Not computed, and 0 returned, when even the trace stays under `floor`. */
static double element_eigenvalue_above(const tm_tissue *tissue, int32_t tet, double floor) {
    const tm_material *material = tm_tissue_tet_material(tissue, tet);
    double G[36], A[36];
    strain_gram(tissue->mesh->shape_1_m + 12 * (int64_t)tet, (const double[4]){1, 1, 1, 1}, G);
    const double scale = 4 / material->density_kg_m3;
    double trace = 0;
    for (int i = 0; i < 6; i++) trace += G[7 * i];
    if (!tissue->smoothed && scale * trace * tm_material_stiffest_Pa(material) <= floor) return 0;
    material_gram(tissue, tet, G, A);
    tm_diagonalise6(A);
    double most = 0;
    for (int i = 0; i < 6; i++) most = fmax(most, A[7 * i]);
    return scale * most;
}

/* The largest eigenvalue of a semidefinite A, from above: the trace of A^(2^k) over its root. Squaring costs a fifth of
 * the rotations; with ten of them the figure is less than 0.2 % too large, were all eigenvalues the same. */
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

double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]) {
    double scale[4], G[36], A[36];
    for (int k = 0; k < 4; k++) scale[k] = tissue->mesh->volume_m3[tet] / mass_kg[k];
    strain_gram(tissue->mesh->shape_1_m + 12 * (int64_t)tet, scale, G);
    material_gram(tissue, tet, G, A);
    return largest_from_above(A);
}

double tm_law_eigenvalue_over(const double law_Pa[36], const double G[36]) {
    double A[36];
    law_gram(law_Pa, G, A);
    return largest_from_above(A);
}

double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet) { return element_eigenvalue_above(tissue, tet, 0); }

/* What rounding may add to the largest eigenvalue: of the assembled tensors, single ones above all. */
static double step_of(const tm_tissue *tissue, double eigenvalue) {
    const double margin = tissue->precision == TM_SINGLE ? 1e-5 : 1e-12;
    return 2 / sqrt(eigenvalue * (1 + margin));
}

double tm_critical_step_element(const tm_tissue *tissue, int32_t tet) {
    TM_REQUIRE(tissue && tet >= 0 && tet < tissue->mesh->tet_count,
               "tissue is null or tet is not one of its tetrahedra", 0);
    return step_of(tissue, tm_element_eigenvalue(tissue, tet));
}

bool tm_critical_step_find(const tm_tissue *tissue, double *step_s, int32_t *tet) {
    double most = 0;
    int32_t worst = -1;
    for (int32_t t = 0; t < tissue->mesh->tet_count; t++) {
        if (!tissue->alive[t]) continue;
        const double e = element_eigenvalue_above(tissue, t, most);
        if (e > most) {
            most = e;
            worst = t;
        }
    }
    /* What hangs on the tissue lives on the extra masses. */
    const bool even = tissue->cuttable || tissue->extra_mass_kg || worst < 0;
    const bool done = even || (tissue->smoothed ? tm_smoothed_eigenvalue(tissue, &most, &worst)
                                                : tm_shared_eigenvalue(tissue, &most, &worst));
    *tet = worst;
    *step_s = worst < 0 ? HUGE_VAL : step_of(tissue, most);
    return done;
}

double tm_critical_step_guaranteed(const tm_tissue *tissue, int32_t *tet) {
    int32_t worst;
    double step_s;
    tm_critical_step_find(tissue, &step_s, &worst);
    if (tet) *tet = worst;
    return step_s;
}

/* --- sharp figure --- */

/* Power iteration for A = M^-1/2 K M^-1/2, made fast by Rayleigh-Ritz over {x, residual, last direction} at each step.
 */
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

/* Makes basis[k] orthogonal to the earlier ones and of unit length, twice over against rounding; false if nothing is
 * left. `image` follows when `follow`. */
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
                if (A[3 * p + q] == 0) continue;
                const double theta = (A[4 * q] - A[4 * p]) / (2 * A[3 * p + q]);
                const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                const double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const double a = A[3 * k + p], b = A[3 * k + q];
                    A[3 * k + p] = c * a - s * b;
                    A[3 * k + q] = s * a + c * b;
                }
                for (int k = 0; k < 3; k++) {
                    const double a = A[3 * p + k], b = A[3 * q + k], x = V[3 * k + p], y = V[3 * k + q];
                    A[3 * p + k] = c * a - s * b;
                    A[3 * q + k] = s * a + c * b;
                    V[3 * k + p] = c * x - s * y;
                    V[3 * k + q] = s * x + c * y;
                }
            }
    int best = 0;
    for (int i = 1; i < m; i++)
        if (A[4 * i] > A[4 * best]) best = i;
    for (int i = 0; i < 3; i++) v[i] = i < m ? V[3 * i + best] : 0;
}

/* Replaces x by the best combination of the first m basis vectors and leaves its move in the direction slot. */
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
    it->scale = TM_TAKE(&it->pool, double, it->n);
    it->work = TM_TAKE(&it->pool, double, it->n);
    for (int j = 0; j < 3; j++) {
        it->basis[j] = TM_TAKE(&it->pool, double, it->n);
        it->image[j] = TM_TAKE(&it->pool, double, it->n);
    }
    if (it->pool.failed) return false;
    uint64_t noise = 0x9e3779b97f4a7c15ULL;
    for (int64_t i = 0; i < it->n; i++) {
        const double mass = tissue->mass_kg[i / 3];
        it->scale[i] = mass > 0 && !(fixed && fixed[i]) ? 1 / sqrt(mass) : 0;
        noise ^= noise << 13, noise ^= noise >> 7, noise ^= noise << 17;
        it->basis[0][i] = it->scale[i] > 0 ? (double)(noise >> 11) / 9007199254740992.0 - 0.5 : 0;
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

tm_status tm_critical_step_sharp(const tm_tissue *tissue, const uint8_t *fixed, double tolerance,
                                 int32_t max_iterations, double *step_s, tm_error *error) {
    TM_REQUIRE(tissue && step_s, "tissue or step_s is null", TM_ERR_ARGUMENT);
    if (!(tolerance > 0) || max_iterations < 1)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "tolerance %g, %d iterations; give positive numbers", tolerance,
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
