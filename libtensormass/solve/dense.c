/* Small dense algebra of the on-line system. */
#include "local.h"

#include <math.h>
#include <string.h>

bool tms_lu(double *restrict a, int32_t *restrict pivot, int32_t n) {
    for (int32_t k = 0; k < n; k++) {
        int32_t best = k;
        for (int32_t i = k + 1; i < n; i++)
            if (fabs(a[(int64_t)i * n + k]) > fabs(a[(int64_t)best * n + k])) best = i;
        pivot[k] = best;
        if (!(fabs(a[(int64_t)best * n + k]) > 1e-300)) return false;
        if (best != k)
            for (int32_t j = 0; j < n; j++) {
                const double t = a[(int64_t)k * n + j];
                a[(int64_t)k * n + j] = a[(int64_t)best * n + j];
                a[(int64_t)best * n + j] = t;
            }
        const double *restrict top = a + (int64_t)k * n;
        const double inverse = 1 / top[k];
        for (int32_t i = k + 1; i < n; i++) {
            double *restrict row = a + (int64_t)i * n;
            const double factor = row[k] * inverse;
            row[k] = factor;
            if (factor != 0)
                for (int32_t j = k + 1; j < n; j++) row[j] -= factor * top[j];
        }
    }
    return true;
}

void tms_lu_solve(const double *a, const int32_t *pivot, int32_t n, double *x) {
    for (int32_t k = 0; k < n; k++) { /* rows were swapped whole, so all swaps come first */
        const double t = x[k];
        x[k] = x[pivot[k]];
        x[pivot[k]] = t;
    }
    for (int32_t i = 1; i < n; i++) {
        double sum = 0;
        for (int32_t j = 0; j < i; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] -= sum;
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        double sum = 0;
        for (int32_t j = i + 1; j < n; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] = (x[i] - sum) / a[(int64_t)i * n + i];
    }
}

/* --- second derivative of the distance from a point to a feature, by the feature's vertices ---
 *
 * x(q) = sum w_k(q) x_k - p, stationary over the feature's own parameters q (two on a face, one on an edge). With n = x/d, C_j the
 * derivative of the weights by q_j, t_j = x_qj and M = t.t:
 *   H = w_k w_l Q / d - N M^-1 B^T - B M^-1 N^T - d N M^-1 N^T,   N_(k,j) = C_jk n,   B_(k,j) = w_k t_j,
 * Q projecting on what is neither n nor t: nothing on a face (its normal turns by N B alone), one direction on an edge, two at a vertex. */

typedef struct feature { int count; int vertex[3]; int q; double change[2][3]; } feature;

static feature feature_of(const tm_contact_row *row) {
    if (row->feature == TM_FEATURE_FACE) return (feature){3, {0, 1, 2}, 2, {{-1, 1, 0}, {-1, 0, 1}}};
    if (row->feature < TM_FEATURE_VERTEX) {
        const int a = row->feature - TM_FEATURE_EDGE, b = (a + 1) % 3;
        feature f = {2, {a, b, 0}, 1, {{0}}};
        f.change[0][a] = -1;
        f.change[0][b] = 1;
        return f;
    }
    return (feature){1, {row->feature - TM_FEATURE_VERTEX, 0, 0}, 0, {{0}}};
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void inverse_gram(const double t[2][3], int q, double inverse[2][2]) {
    const double a = q > 0 ? dot(t[0], t[0]) : 1, b = q > 1 ? dot(t[0], t[1]) : 0, c = q > 1 ? dot(t[1], t[1]) : 1;
    const double det = a * c - b * b;
    const double s = det > 1e-30 ? 1 / det : 0;
    inverse[0][0] = c * s, inverse[1][1] = a * s, inverse[0][1] = inverse[1][0] = -b * s;
}

/* Q w w / d, row by row; the direction beside an edge, or the whole tangent plane at a vertex. */
static void add_beside(const tm_contact_row *row, const double t[2][3], int q, double d, double H[81]) {
    double Q[9] = {0};
    const double *n = row->normal;
    if (q == 0) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) Q[3 * i + j] = (i == j) - n[i] * n[j];
    } else {
        double s[3] = {n[1] * t[0][2] - n[2] * t[0][1], n[2] * t[0][0] - n[0] * t[0][2], n[0] * t[0][1] - n[1] * t[0][0]};
        const double length = dot(s, s);
        for (int i = 0; i < 9 && length > 0; i++) Q[i] = s[i / 3] * s[i % 3] / length;
    }
    for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++)
            for (int i = 0; i < 9; i++) H[9 * (3 * k + i / 3) + 3 * l + i % 3] += row->weight[k] * row->weight[l] * Q[i] / d;
}

static void turning_normal(const tm_contact_row *row, const double x[3][3], double radius, double H[81]) {
    const feature f = feature_of(row);
    double t[2][3] = {{0}}, inverse[2][2], NM[9][2] = {{0}}, B[9][2], N[9][2];
    const double *n = row->normal, d = row->gap_m + radius;
    for (int j = 0; j < f.q; j++)
        for (int k = 0; k < 3; k++)
            for (int c = 0; c < 3; c++) t[j][c] += f.change[j][k] * x[k][c];
    inverse_gram(t, f.q, inverse);
    for (int a = 0; a < 9; a++)
        for (int j = 0; j < 2; j++) {
            N[a][j] = j < f.q ? f.change[j][a / 3] * n[a % 3] : 0;
            B[a][j] = j < f.q ? row->weight[a / 3] * t[j][a % 3] : 0;
        }
    for (int a = 0; a < 9; a++)
        for (int j = 0; j < 2; j++) NM[a][j] = N[a][0] * inverse[0][j] + N[a][1] * inverse[1][j];
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++)
            for (int j = 0; j < 2; j++) H[9 * a + b] -= NM[a][j] * B[b][j] + NM[b][j] * B[a][j] + d * NM[a][j] * N[b][j];
    if (f.q < 2) add_beside(row, t, f.q, fmax(fabs(d), 0.2 * radius), H);
}

void tms_row_stiffness(const tm_contact_row *row, const double x[3][3], double radius, double slope, double D[81]) {
    memset(D, 0, 81 * sizeof *D);
    turning_normal(row, x, radius, D);
    for (int i = 0; i < 81; i++) D[i] *= -row->lambda_N;
    for (int a = 0; a < 9 && slope > 0; a++)
        for (int b = 0; b < 9; b++) D[9 * a + b] += row->weight[a / 3] * row->normal[a % 3] * row->weight[b / 3] * row->normal[b % 3] / slope;
}
