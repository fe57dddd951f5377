/* The tangent of what turns: second derivatives of the energy of one tetrahedron, and the tensors of the whole. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "rotation/rotation_internal.h"

/* --- 3x3 --- */

static void transposed_times(const double A[9], const double B[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

static double product(const double A[9], const double B[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += A[i] * B[i];
    return sum;
}

static void axial(const double A[9], double a[3]) { a[0] = A[7] - A[5], a[1] = A[2] - A[6], a[2] = A[3] - A[1]; }

static void turn_about(int i, const double M[9], double X[9]) {
    const int a = (i + 1) % 3, b = (i + 2) % 3;
    for (int j = 0; j < 3; j++) {
        X[3 * i + j] = 0;
        X[3 * a + j] = -M[3 * b + j];
        X[3 * b + j] = M[3 * a + j];
    }
}

/* Solves S x = b of a symmetric S (00 01 02 11 12 22) that is positive, or made so. */
static void solve3(const double S[6], const double b[3], double x[3]) {
    const double c00 = S[3] * S[5] - S[4] * S[4], c01 = S[2] * S[4] - S[1] * S[5], c02 = S[1] * S[4] - S[2] * S[3];
    const double c11 = S[0] * S[5] - S[2] * S[2], c12 = S[1] * S[2] - S[0] * S[4], c22 = S[0] * S[3] - S[1] * S[1];
    const double size = fabs(S[0]) + fabs(S[3]) + fabs(S[5]);
    const double det = fmax(S[0] * c00 + S[1] * c01 + S[2] * c02, 1e-9 * size * size * size + 1e-300);
    x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det;
    x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det;
    x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det;
}

/* --- the laws --- */

/* N = (C:sym D) + 2 g skew D: the derivative of the law's energy w(sym D) + g |skew D|^2. */
static void stress(const tm_turned_lane *w, double skew, const double D[9], double N[9]) {
    double E[9], Ea[3];
    const double *a = w->fibre;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) E[3 * i + j] = 0.5 * (D[3 * i + j] + D[3 * j + i]);
    for (int i = 0; i < 3; i++) Ea[i] = vdot(E + 3 * i, a);
    const double I1 = E[0] + E[4] + E[8], I4 = vdot(a, Ea);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            N[3 * i + j] = 2 * w->mu * E[3 * i + j] + (w->dlambda * I1 + w->beta * I4) * a[i] * a[j] +
                           2 * w->dmu * (a[i] * Ea[j] + Ea[i] * a[j]) + skew * (D[3 * i + j] - D[3 * j + i]) +
                           (i == j ? w->lambda * I1 + w->dlambda * I4 : 0);
}

/* A = d2(tr S)/dF2: the turn that F asks for, over tr S - S. Returns tr S. */
static double stretch_hessian(const double H[9], const double R[9], double A[81]) {
    double F[9], S[9], unit[9], turn[9][3], solved[9][3];
    for (int i = 0; i < 9; i++) F[i] = H[i] + (i % 4 ? 0 : 1);
    transposed_times(R, F, S);
    const double trace = S[0] + S[4] + S[8];
    const double G[6] = {trace - S[0], -0.5 * (S[1] + S[3]), -0.5 * (S[2] + S[6]),
                         trace - S[4], -0.5 * (S[5] + S[7]), trace - S[8]};
    for (int k = 0; k < 9; k++) {
        double D[9];
        memset(unit, 0, sizeof unit);
        unit[k] = 1;
        transposed_times(R, unit, D);
        axial(D, turn[k]);
        solve3(G, turn[k], solved[k]);
    }
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++) A[9 * k + m] = vdot(turn[k], solved[m]);
    return trace;
}

/* Of mu |F - R|^2 and the volume's part. */
static void isotropic_hessian(const tm_turned_lane *w, double A[81]) {
    const double trace = stretch_hessian(w->H, w->R, A), most = fmax(2 * w->mu, 0.2 * w->lambda);
    const bool slack = w->lambda * (trace - 3) > most;
    const double save = 2 * w->mu - (slack ? most : w->lambda * (trace - 3)), volume = slack ? 0 : w->lambda;
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++)
            A[9 * k + m] = (k == m ? 2 * w->mu : 0) + volume * w->R[k] * w->R[m] - save * A[9 * k + m];
}

/* Of min over R of Q(R^T F - 1), Q the law with what a turn costs: Q'' less what turning saves. */
static void fibred_hessian(const tm_turned_lane *w, double A[81]) {
    double F[9], M[9], N[9], B[9], X[3][9], QX[3][9], S[6], saves[9][3], solved[9][3], unit[9], D[9][9], QD[9][9];
    for (int i = 0; i < 9; i++) F[i] = w->H[i] + (i % 4 ? 0 : 1);
    transposed_times(w->R, F, M);
    for (int i = 0; i < 9; i++) unit[i] = M[i] - (i % 4 ? 0 : 1);
    stress(w, w->skew, unit, N);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) B[3 * i + j] = vdot(N + 3 * i, M + 3 * j);
    for (int i = 0; i < 3; i++) {
        turn_about(i, M, X[i]);
        stress(w, w->skew, X[i], QX[i]);
    }
    for (int i = 0, at = 0; i < 3; i++)
        for (int j = i; j < 3; j++, at++)
            S[at] = product(QX[i], X[j]) + 0.5 * (B[3 * i + j] + B[3 * j + i]) - (i == j ? B[0] + B[4] + B[8] : 0);
    for (int k = 0; k < 9; k++) {
        memset(unit, 0, sizeof unit);
        unit[k] = 1;
        transposed_times(w->R, unit, D[k]);
        stress(w, w->skew, D[k], QD[k]);
        for (int i = 0; i < 3; i++) {
            double turned[9];
            turn_about(i, D[k], turned);
            saves[k][i] = product(QX[i], D[k]) + product(N, turned);
        }
        solve3(S, saves[k], solved[k]);
    }
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++) A[9 * k + m] = product(QD[k], D[m]) - vdot(saves[k], solved[m]);
}

void tm_rotation_linear(const tm_turned_lane *w, double A[81]) {
    for (int k = 0; k < 9; k++) {
        double unit[9] = {0};
        unit[k] = 1;
        stress(w, 0, unit, A + 9 * k);
    }
}

void tm_rotation_hessian(const tm_turned_lane *w, double A[81]) {
    double linear[81];
    (w->fibred ? fibred_hessian : isotropic_hessian)(w, A);
    tm_rotation_linear(w, linear);
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++)
            A[9 * k + m] = w->weight * (A[9 * k + m] - linear[9 * k + m]) +
                           2 * w->slope * (w->H[k] * w->stress[m] + w->stress[k] * w->H[m]) +
                           4 * w->bend * w->energy_J * w->H[k] * w->H[m] + (k == m ? 2 * w->slope * w->energy_J : 0);
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < k; m++) A[9 * k + m] = A[9 * m + k] = 0.5 * (A[9 * k + m] + A[9 * m + k]);
}

/* --- the whole --- */

bool tm_tangent_take(tm_tangent *tangent, tm_pool *pool, const tm_rotation *rotation) {
    const tm_tissue *tissue = rotation->tissue;
    if (!tm_swollen_take_look(&tangent->swollen, pool, &rotation->swollen, rotation->packs.count)) return false;
    if (tissue->smoothed)
        tangent->gradient = TM_TAKE(pool, double, 3 * (int64_t)tm_swollen_most_members(&rotation->swollen));
    tangent->graph = tissue->graph;
    tangent->graph.vertex_tensor = TM_TAKE(pool, double, 9 * (int64_t)tissue->mesh->vertex_count + TM_FORCE_PADDING);
    tangent->graph.edge_tensor = TM_TAKE(pool, double, 8 * (int64_t)tissue->pair_count);
    tangent->graph.edge_last = TM_TAKE(pool, double, tissue->pair_count);
    tangent->force = tm_force_choose(tissue->plain, false);
    return !pool->failed;
}

/* K_kl of one tetrahedron from its 9x9: rows the components of k. */
static void block(const double A[81], const double *k, const double *l, double K[9]) {
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < 3; a++) {
            K[3 * i + a] = 0;
            for (int j = 0; j < 3; j++)
                for (int b = 0; b < 3; b++) K[3 * i + a] += A[9 * (3 * i + j) + 3 * a + b] * k[j] * l[b];
        }
}

static void add_tet(const tm_tissue *tissue, int32_t tet, const double A[81], tm_force_graph *graph) {
    const tm_mesh *mesh = tissue->mesh;
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    const int32_t *v = mesh->tet + 4 * (int64_t)tet;
    double K[9];
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++) {
            if (v[l] < v[k]) continue;
            block(A, alpha + 3 * k, alpha + 3 * l, K);
            tm_tangent_add(tissue, graph, v[k], v[l], K);
        }
}

/* What a turn changes of one tetrahedron's change of volume, under the pressures around it. */
static void add_swelling(const tm_tissue *tissue, int32_t tet, const double *u_m, tm_tangent *tangent) {
    const tm_mesh *mesh = tissue->mesh;
    const tm_swollen *s = &tangent->swollen;
    const double *turn = s->turn + 9 * TM_LANES * (int64_t)(tet / TM_LANES) + tet % TM_LANES;
    double H[9] = {0}, R[9], A[81];
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 9; i++)
            H[i] += u_m[3 * (int64_t)mesh->tet[4 * (int64_t)tet + k] + i / 3] *
                    mesh->shape_1_m[12 * (int64_t)tet + 3 * k + i % 3];
    for (int i = 0; i < 9; i++) R[i] = turn[TM_LANES * i];
    stretch_hessian(H, R, A);
    double pull = 0;
    for (int k = 0; k < 4; k++) pull += s->turned[s->domain[4 * (int64_t)tet + k]];
    for (int i = 0; i < 81; i++) A[i] *= s->quarter_m3[tet] * pull;
    add_tet(tissue, tet, A, &tangent->graph);
}

void tm_rotation_tangent_begin(const tm_rotation *rotation, tm_tangent *tangent) {
    const tm_tissue *tissue = rotation->tissue;
    const tm_mesh *mesh = tissue->mesh;
    double K[9];
    memcpy(tangent->graph.vertex_tensor, tissue->graph.vertex_tensor, 9 * sizeof(double) * (size_t)mesh->vertex_count);
    for (int32_t p = 0; p < tissue->pair_count; p++) {
        const int32_t slot = tm_tissue_edge_slot(tissue, p);
        if (slot < 0) continue;
        tm_tissue_pair_tensor(tissue, p, K);
        tm_edge_write(&tangent->graph, slot, K);
    }
}

void tm_rotation_tangent_add(const tm_rotation *rotation, const double *u_m, int32_t begin, int32_t end,
                             tm_tangent *tangent) {
    const tm_tissue *tissue = rotation->tissue;
    const int64_t tets = tissue->mesh->tet_count, vertices = tissue->mesh->vertex_count;
    double A[81];
    tm_turned_lane lane;
    if (tissue->smoothed) {
        if (begin == 0) tm_swollen_look(&tangent->swollen, &rotation->packs, tissue->plain, u_m);
        tm_swollen_tangent(&tangent->swollen, (int32_t)(vertices * begin / tets), (int32_t)(vertices * end / tets),
                           tangent);
        for (int32_t t = begin; t < end; t++)
            if (tissue->alive[t]) add_swelling(tissue, t, u_m, tangent);
    }
    for (int32_t t = begin; t < end; t++) {
        if (!tissue->alive[t] || !tm_rotation_lane(&rotation->packs, t, u_m, &lane)) continue;
        tm_rotation_hessian(&lane, A);
        add_tet(tissue, t, A, &tangent->graph);
    }
}

void tm_rotation_tangent(const tm_rotation *rotation, const double *u_m, tm_tangent *tangent) {
    tm_rotation_tangent_begin(rotation, tangent);
    tm_rotation_tangent_add(rotation, u_m, 0, rotation->tissue->mesh->tet_count, tangent);
}
