/* The tangent of what turns: second derivatives of the energy of one tetrahedron, and the tensors of the whole. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "material/material_internal.h"

/* --- 3x3 --- */

static double product(const double A[9], const double B[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += A[i] * B[i];
    return sum;
}

/* C = A B, A^T B and A B^T. */
static void times(const double A[9], const double B[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}
static void transposed_times(const double A[9], const double B[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

/* What is bilinear in A and B, and of F twice is twice its cofactors. */
static void cofactors(const double A[9], const double B[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = 3 * ((i + 1) % 3), b = 3 * ((i + 2) % 3), c = (j + 1) % 3, d = (j + 2) % 3;
            C[3 * i + j] = A[a + c] * B[b + d] + B[a + c] * A[b + d] - A[a + d] * B[b + c] - B[a + d] * A[b + c];
        }
}

static void gradient_to_F(const double H[9], double F[9]) {
    for (int i = 0; i < 9; i++) F[i] = H[i] + (i % 4 ? 0 : 1);
}

/* --- the laws --- */

/* N = C:sym D: the derivative of the linear law's energy. */
static void stress(const tm_turned_lane *w, const double D[9], double N[9]) {
    double E[9], Ea[3];
    const double *a = w->fibre;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) E[3 * i + j] = 0.5 * (D[3 * i + j] + D[3 * j + i]);
    for (int i = 0; i < 3; i++) Ea[i] = vdot(E + 3 * i, a);
    const double I1 = E[0] + E[4] + E[8], I4 = vdot(a, Ea);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            N[3 * i + j] = 2 * w->mu * E[3 * i + j] + (w->dlambda * I1 + w->beta * I4) * a[i] * a[j] +
                           2 * w->dmu * (a[i] * Ea[j] + Ea[i] * a[j]) + (i == j ? w->lambda * I1 + w->dlambda * I4 : 0);
}

/* Second derivatives of d (corotated_kernel.h) by I and J. */
typedef struct parting {
    double I, J, II, IJ, JJ;
} parting;
static parting part(double I, double J) {
    const double size = (I + TM_PART_SIZE) / 3, scale = pow(size, -1.5), j = J * scale;
    const double width = TM_PART_FROM - TM_PART_WHOLE, t = fmin(fmax((TM_PART_FROM - j) / width, 0), 1);
    const double share = TM_PART_MOST * t * t * t * (10 - t * (15 - 6 * t));
    const double slope = -30 * TM_PART_MOST / width * t * (1 - t) * t * (1 - t);
    const double bend = 60 * TM_PART_MOST / (width * width) * t * (1 - t) * (1 - 2 * t);
    const double j_I = -0.5 * j / size, j_IJ = -0.5 * scale / size, j_II = 5.0 / 12 * j / (size * size),
                 s2 = size * size;
    return (parting){.I = 2.0 / 3 * size * share + s2 * slope * j_I,
                     .J = s2 * slope * scale,
                     .II = 2.0 / 9 * share + 4.0 / 3 * size * slope * j_I + s2 * (bend * j_I * j_I + slope * j_II),
                     .IJ = 2.0 / 3 * size * slope * scale + s2 * (bend * j_I * scale + slope * j_IJ),
                     .JJ = s2 * bend * scale * scale};
}

/* A = d2x/dF2 of the trace x = tr S, whose gradient is R: R is N over D (corotated_kernel.h), both polynomials. */
static void stretch_hessian(const double F[9], const double R[9], double x, double A[81]) {
    double C[9], cof[9];
    transposed_times(F, F, C);
    cofactors(F, F, cof);
    for (int i = 0; i < 9; i++) cof[i] *= 0.5;
    const double I = C[0] + C[4] + C[8], J = product(F, cof) / 3;
    const parting d = part(I, J);
    const double D = fmax(x * (x * x - I) - 2 * J, 1e-9 * x * I + 1e-300);
    const double of_F = x * x + I + 0.5 * d.I, of_cof = 2 * x + 0.25 * d.J;
    for (int k = 0; k < 9; k++) {
        double G[9] = {0}, GC[9], FtG[9], sum[9], turned[9], change[9];
        G[k] = 1;
        times(G, C, GC);
        transposed_times(F, G, FtG);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) sum[3 * i + j] = FtG[3 * i + j] + FtG[3 * j + i];
        times(F, sum, turned);
        cofactors(F, G, change);
        const double x1 = R[k], I1 = 2 * F[k], J1 = cof[k];
        const double F1 = 2 * x * x1 + I1 + 0.5 * (d.II * I1 + d.IJ * J1);
        const double cof1 = 2 * x1 + 0.25 * (d.IJ * I1 + d.JJ * J1), D1 = (3 * x * x - I) * x1 - x * I1 - 2 * J1;
        for (int m = 0; m < 9; m++)
            A[9 * k + m] =
                (F1 * F[m] + of_F * G[m] - 2 * (GC[m] + turned[m]) + cof1 * cof[m] + of_cof * change[m] - R[m] * D1) /
                D;
    }
}

/* Of mu |F - R|^2 and the volume's part. */
static void isotropic_hessian(const tm_turned_lane *w, const double turn[81], double A[81]) {
    const double most = fmax(2 * w->mu, 0.2 * w->lambda), grown = w->trace - 3;
    const bool slack = w->lambda * grown > most;
    const double save = 2 * w->mu - (slack ? most : w->lambda * grown), volume = slack ? 0 : w->lambda;
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++)
            A[9 * k + m] = (k == m ? 2 * w->mu : 0) + volume * w->R[k] * w->R[m] - save * turn[9 * k + m];
}

/* A += 2 dmu d2p/dF2 of a fibre's shear (corotated_kernel.h). */
static void add_fibre_shear(const tm_turned_lane *w, const double F[9], const double g[3], double A[81]) {
    const double *a = w->fibre, c2 = TM_FIBRE_CRUSHED * TM_FIBRE_CRUSHED, z = vdot(g, g);
    double Ca[3], dCa[9][3], N1[9], q1[9], q = z;
    for (int i = 0; i < 3; i++) Ca[i] = F[i] * g[0] + F[3 + i] * g[1] + F[6 + i] * g[2];
    for (int i = 0; i < 9; i++) q += F[i] * F[i];
    const bool crushed = q < TM_FIBRE_CRUSHED;
    const double N = vdot(Ca, Ca) - z * z, sum = c2 + q * q;
    const double Q = crushed ? sum * sum / (4 * c2) : q * q, Q1 = crushed ? sum * q / c2 : 2 * q,
                 Q2 = crushed ? (sum + 2 * q * q) / c2 : 2;
    for (int k = 0; k < 9; k++) {
        for (int i = 0; i < 3; i++) dCa[k][i] = (k % 3 == i ? g[k / 3] : 0) + F[k / 3 * 3 + i] * a[k % 3];
        N1[k] = 2 * vdot(Ca, dCa[k]) - 4 * z * g[k / 3] * a[k % 3];
        q1[k] = 2 * F[k] + 2 * g[k / 3] * a[k % 3];
    }
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++) {
            const bool row = k / 3 == m / 3;
            const double aa = row ? a[k % 3] * a[m % 3] : 0;
            const double mixed = row ? Ca[k % 3] * a[m % 3] + Ca[m % 3] * a[k % 3] : 0;
            const double N2 =
                2 * vdot(dCa[k], dCa[m]) + 2 * mixed - 8 * g[k / 3] * a[k % 3] * g[m / 3] * a[m % 3] - 4 * z * aa;
            const double q2 = 2 * aa + (k == m ? 2 : 0);
            A[9 * k + m] += 8 * w->dmu / Q *
                            (N2 - (N1[k] * q1[m] + q1[k] * N1[m]) * Q1 / Q - N * (Q2 * q1[k] * q1[m] + Q1 * q2) / Q +
                             2 * N * Q1 * Q1 * q1[k] * q1[m] / (Q * Q));
        }
}

/* level of corotated_kernel.h and its derivatives. */
static void level(double t, double out[3]) {
    const double c = fmin(fmax(t, -2 * TM_FIBRE_FREE), 2 * TM_FIBRE_FREE), over = fmax(fabs(c) - TM_FIBRE_FREE, 0);
    out[0] = c - copysign(over * over * 0.5 / TM_FIBRE_FREE, c);
    out[1] = 1 - over / TM_FIBRE_FREE;
    out[2] = over > 0 && c == t ? -copysign(1 / TM_FIBRE_FREE, c) : 0;
}

static void add_fibred_hessian(const tm_turned_lane *w, const double F[9], const double turn[81], double A[81]) {
    const double *a = w->fibre, grown = w->trace - 3, stiff = w->beta + 4 * w->dmu;
    double g[3], x[3], e[3], L[9];
    for (int i = 0; i < 3; i++) g[i] = vdot(F + 3 * i, a);
    const double root = sqrt(vdot(g, g)), over = fmax(root, TM_FIBRE_SHORT);
    const bool shrunk = root < TM_FIBRE_SHORT;
    const double e0 = (shrunk ? 0.5 * (root * root / TM_FIBRE_SHORT + TM_FIBRE_SHORT) : root) - 1;
    level(grown, x), level(e0, e);
    const bool beyond = w->lambda < 0 && grown > TM_FIBRE_FREE;
    const double of_x = w->dlambda * x[1] * e[0] - (beyond ? w->lambda * (grown - TM_FIBRE_FREE) : 0);
    const double of_e = w->dlambda * x[0] * e[1] + stiff * fmin(e0, TM_FIBRE_FREE);
    const double xx = w->dlambda * x[2] * e[0] - (beyond ? w->lambda : 0), xe = w->dlambda * x[1] * e[1];
    const double ee = w->dlambda * x[0] * e[2] + (e0 > TM_FIBRE_FREE ? 0 : stiff);
    for (int k = 0; k < 9; k++) L[k] = g[k / 3] * a[k % 3] / over;
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++)
            A[9 * k + m] += of_x * turn[9 * k + m] + xx * w->R[k] * w->R[m] + xe * (w->R[k] * L[m] + L[k] * w->R[m]) +
                            ee * L[k] * L[m] +
                            of_e / over * ((k / 3 == m / 3 ? a[k % 3] * a[m % 3] : 0) - (shrunk ? 0 : L[k] * L[m]));
    add_fibre_shear(w, F, g, A);
}

void tm_rotation_linear(const tm_turned_lane *w, double A[81]) {
    for (int k = 0; k < 9; k++) {
        double unit[9] = {0};
        unit[k] = 1;
        stress(w, unit, A + 9 * k);
    }
}

void tm_rotation_hessian(const tm_turned_lane *w, double A[81]) {
    double linear[81], F[9], turn[81];
    gradient_to_F(w->H, F);
    stretch_hessian(F, w->R, w->trace, turn);
    isotropic_hessian(w, turn, A);
    if (w->fibred) add_fibred_hessian(w, F, turn, A);
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
    tangent->definite = false;
    if (!tm_swollen_take_look(&tangent->swollen, pool, &rotation->swollen, rotation->packs.count)) return false;
    if (tissue->smoothed)
        tangent->gradient = TM_TAKE(pool, double, 3 * (int64_t)tm_swollen_most_members(&rotation->swollen));
    tangent->graph = tissue->graph;
    tangent->graph.vertex_tensor = TM_TAKE(pool, double, 9 * (int64_t)tissue->mesh->vertex_count + TM_FORCE_PADDING);
    tangent->graph.edge_tensor = TM_TAKE(pool, double, 8 * (int64_t)tissue->pair_count);
    tangent->graph.edge_last = TM_TAKE(pool, double, tissue->pair_count);
    tangent->force = tm_force_choose(tissue->plain, false);
    tangent->definite = false;
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

/* weight (R K R^T - K) of each of a tetrahedron's blocks. */
static void add_turned(const tm_tissue *tissue, int32_t tet, const tm_turned_lane *w, tm_force_graph *graph) {
    const tm_mesh *mesh = tissue->mesh;
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    const int32_t *v = mesh->tet + 4 * (int64_t)tet;
    double A[81], K[9], half[9];
    tm_rotation_linear(w, A);
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < 4; l++) {
            if (v[l] < v[k]) continue;
            block(A, alpha + 3 * k, alpha + 3 * l, K);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) half[3 * i + j] = vdot(K + 3 * i, w->R + 3 * j);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    double turned = 0;
                    for (int m = 0; m < 3; m++) turned += w->R[3 * i + m] * half[3 * m + j];
                    K[3 * i + j] = w->weight * (turned - K[3 * i + j]);
                }
            tm_tangent_add(tissue, graph, v[k], v[l], K);
        }
}

/* What a turn changes of one tetrahedron's change of volume, under the pressures around it. */
static void add_swelling(const tm_tissue *tissue, int32_t tet, const double *u_m, tm_tangent *tangent) {
    const tm_mesh *mesh = tissue->mesh;
    const tm_swollen *s = &tangent->swollen;
    const double *turn = s->turn + 9 * TM_LANES * (int64_t)(tet / TM_LANES) + tet % TM_LANES;
    double H[9] = {0}, F[9], R[9], A[81];
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 9; i++)
            H[i] += u_m[3 * (int64_t)mesh->tet[4 * (int64_t)tet + k] + i / 3] *
                    mesh->shape_1_m[12 * (int64_t)tet + 3 * k + i % 3];
    for (int i = 0; i < 9; i++) R[i] = turn[TM_LANES * i];
    gradient_to_F(H, F);
    stretch_hessian(F, R, s->grown[tet] / s->quarter_m3[tet] + 3, A);
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
        for (int32_t t = begin; t < end && !tangent->definite; t++)
            if (tissue->alive[t]) add_swelling(tissue, t, u_m, tangent);
    }
    for (int32_t t = begin; t < end; t++) {
        if (!tissue->alive[t] || !tm_rotation_lane(&rotation->packs, t, u_m, &lane)) continue;
        if (tangent->definite) {
            add_turned(tissue, t, &lane, &tangent->graph);
            continue;
        }
        tm_rotation_hessian(&lane, A);
        add_tet(tissue, t, A, &tangent->graph);
    }
}

void tm_rotation_tangent(const tm_rotation *rotation, const double *u_m, tm_tangent *tangent) {
    tm_rotation_tangent_begin(rotation, tangent);
    tm_rotation_tangent_add(rotation, u_m, 0, rotation->tissue->mesh->tet_count, tangent);
}

/* --- a tissue by itself --- */

double tm_tissue_rotation(const tm_tissue *tissue) {
    TM_REQUIRE(tissue, "tissue is null", 0);
    return tissue->rotation;
}

static bool turn(tm_tissue *tissue, const double *u_m, tm_pool *pool) {
    tm_rotation rotation = {.tissue = tissue};
    tm_tangent tangent = {0};
    if (!tm_packs_take(&rotation.packs, pool, tissue) ||
        !tm_swollen_take(&rotation.swollen, pool, tissue, rotation.packs.count) ||
        !tm_tangent_take(&tangent, pool, &rotation))
        return false;
    tangent.definite = true;
    tm_rotation_tangent(&rotation, u_m, &tangent);
    memcpy(tissue->graph.vertex_tensor, tangent.graph.vertex_tensor,
           9 * sizeof(double) * (size_t)tissue->mesh->vertex_count);
    memcpy(tissue->graph.edge_tensor, tangent.graph.edge_tensor, 8 * sizeof(double) * (size_t)tissue->pair_count);
    memcpy(tissue->graph.edge_last, tangent.graph.edge_last, sizeof(double) * (size_t)tissue->pair_count);
    return true;
}

tm_status tm_tissue_turn(tm_tissue *tissue, double threshold, const double *u_m, tm_error *error) {
    TM_REQUIRE(tissue && u_m, "tissue or u_m is null", TM_ERR_ARGUMENT);
    if (!(threshold > 0) || tissue->precision != TM_DOUBLE || tm_tissue_volume_shear(tissue) > 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "tensors of tissue that turns beyond %g: give a threshold above 0, precision double and no "
                       "averaged shear",
                       threshold);
    tm_pool pool = {0};
    tissue->rotation = threshold;
    const bool good = turn(tissue, u_m, &pool);
    tm_pool_release(&pool);
    return good ? TM_OK : tm_fail_memory(error, "tensors of tissue that turns");
}
