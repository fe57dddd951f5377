/* The tangent of corotated tetrahedra: second derivatives of the energy of one, and the tensors of all. */
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

/* The bilinear form of cofactors: for F and F it is twice the cofactors of F. */
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
static void stress(const tm_corotated_lane *w, const double D[9], double N[9]) {
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
    const double size = (I + TM_CORRECTION_SIZE) / 3, scale = pow(size, -1.5), j = J * scale;
    const double width = TM_CORRECTION_FROM - TM_CORRECTION_FULL,
                 t = fmin(fmax((TM_CORRECTION_FROM - j) / width, 0), 1);
    const double share = TM_CORRECTION_MAX * t * t * t * (10 - t * (15 - 6 * t));
    const double slope = -30 * TM_CORRECTION_MAX / width * t * (1 - t) * t * (1 - t);
    const double bend = 60 * TM_CORRECTION_MAX / (width * width) * t * (1 - t) * (1 - 2 * t);
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

/* Second derivatives of mu |F - R|^2 and of the volume's part. */
static void isotropic_hessian(const tm_corotated_lane *w, const double turn[81], double A[81]) {
    const double most = fmax(2 * w->mu, 0.2 * w->lambda), grown = w->trace - 3;
    const bool slack = w->lambda * grown > most;
    const double save = 2 * w->mu - (slack ? most : w->lambda * grown), volume = slack ? 0 : w->lambda;
    for (int k = 0; k < 9; k++)
        for (int m = 0; m < 9; m++)
            A[9 * k + m] = (k == m ? 2 * w->mu : 0) + volume * w->R[k] * w->R[m] - save * turn[9 * k + m];
}

/* A += 2 dmu d2p/dF2 of a fibre's shear (corotated_kernel.h). */
static void add_fibre_shear(const tm_corotated_lane *w, const double F[9], const double g[3], double A[81]) {
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

/* `level` of corotated_kernel.h and its derivatives. */
static void level(double t, double out[3]) {
    const double c = fmin(fmax(t, -2 * TM_FIBRE_FREE), 2 * TM_FIBRE_FREE), over = fmax(fabs(c) - TM_FIBRE_FREE, 0);
    out[0] = c - copysign(over * over * 0.5 / TM_FIBRE_FREE, c);
    out[1] = 1 - over / TM_FIBRE_FREE;
    out[2] = over > 0 && c == t ? -copysign(1 / TM_FIBRE_FREE, c) : 0;
}

static void add_fibred_hessian(const tm_corotated_lane *w, const double F[9], const double turn[81], double A[81]) {
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

void tm_rotation_linear(const tm_corotated_lane *w, double A[81]) {
    for (int k = 0; k < 9; k++) {
        double unit[9] = {0};
        unit[k] = 1;
        stress(w, unit, A + 9 * k);
    }
}

void tm_rotation_hessian(const tm_corotated_lane *w, double A[81]) {
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

void tm_stretch_hessian(const double H[9], const double R[9], double trace, double A[81]) {
    double F[9];
    gradient_to_F(H, F);
    stretch_hessian(F, R, trace, A);
}
