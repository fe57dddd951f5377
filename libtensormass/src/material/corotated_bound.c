/* Bound for the guaranteed step of corotated tissue: of the curvature of the law of material/corotated_kernel.h over
 * all F, crushed and inverted ones included.
 *
 * Isotropic: W = mu |F|^2 - (2 mu - p) x + ..., with x the trace of the stretch. x is convex, except slightly where its
 * roots are kept apart (x'' >= -0.08). So as long as the tension p of the volume is below 2 mu, W'' <= Q'' of Q(D) =
 * w(sym D) + mu |skew D|^2 (corotated): the bound of the linear law with 2 mu for rotations instead of 0. Two terms are
 * added. One is the addition to rotations where p may be above (for tetrahedra whose two smaller stretches add up to a
 * half or more). The other is the addition by the band in which the correction grows, BAND times its end, which covers
 * the 0.08. Fibred: rotations cost a quarter of the largest stiffness, and fibred_excess is added. Both were found by
 * search over states of all kinds and 17 materials (tests/physics/test_rotation.c has some), not proved. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "material/material_internal.h"

static const double BAND = 1.7;
/* Margin below 2/omega: there the amplitude at given energy is unbounded, and so is the energy that a step generates
 * (world/conserve.c). With 1 the energy oscillates by up to a factor of two (tests/physics/test_conserve.c). */
static const double CONSERVING = 1.25;

double tm_corotated_skew_Pa(const tm_material *m) {
    return tm_material_is_isotropic(m) ? m->mu_Pa : tm_material_stiffest_Pa(m) / 4;
}

double tm_corotated_tension_max_Pa(const tm_material *m) {
    return fmax(tm_corotated_skew_Pa(m), 0.2 * tm_material_bulk_Pa(m));
}

/* Bound with averaged dilatation (material/nodal_dilatation.h). The rotations of least total energy store sum Q_e' +
 * sum V kappa/2 (average of tr(R^T F) - 3)^2. The second part curves no more than that of each tetrahedron's own
 * dilatation: the bound is that of the complete law. The polar R has not the least energy where neighbours put more
 * tension on a tetrahedron than its own shear allows, 2/3 mu tr S. As above, that addition holds for two stretches that
 * add up to a half. */
static double averaged_turn(const tm_material *m) {
    const double most = tm_corotated_tension_max_Pa(m);
    return fmax(4 * most - (tm_material_is_isotropic(m) ? 4.0 / 3 * m->mu_Pa : 0), 0);
}

/* Returns what a fibre rotated away from the axes of the linear law may need beyond that law: its parts one by one,
 * minus the largest stiffness. 0 for fibres that stiffen the tissue along themselves. */
static double fibred_excess(const tm_material *m) {
    const double along = m->beta_Pa + 4 * m->dmu_Pa;
    const double parts = 2 * m->mu_Pa + fmax(4 * m->dmu_Pa, -3 * m->dmu_Pa) + fmax(along, -2 * along) +
                         fmax(2 * m->dlambda_Pa, -8 * m->dlambda_Pa);
    return tm_material_is_isotropic(m) ? 0 : fmax(parts - 1.1 * tm_material_stiffest_Pa(m), 0);
}

/* Lower Cholesky factor of Q'' in Mandel form, six strains and three rotations. */
static void factor(const tm_material *m, const double *fibre, double end, bool averaged, double L[81]) {
    double C[36];
    const double stiffest = tm_material_stiffest_Pa(m), more = BAND * end * stiffest + fibred_excess(m);
    double turn = 2 * tm_corotated_skew_Pa(m);
    if (averaged)
        turn += averaged_turn(m);
    else if (tm_material_is_isotropic(m))
        turn += 4 * fmax(0.2 * m->lambda_Pa - 2 * m->mu_Pa, 0);
    tm_material_voigt(m, fibre, C);
    memset(L, 0, 81 * sizeof(double));
    for (int j = 0; j < 6; j++)
        for (int i = j; i < 6; i++) {
            double s = C[6 * i + j] * (i > 2 ? sqrt(2.0) : 1) * (j > 2 ? sqrt(2.0) : 1) + (i == j ? more : 0);
            for (int k = 0; k < j; k++) s -= L[9 * i + k] * L[9 * j + k];
            L[9 * i + j] = i == j ? sqrt(fmax(s, 0)) : L[10 * j] > 0 ? s / L[10 * j] : 0;
        }
    for (int j = 6; j < 9; j++) L[10 * j] = sqrt(turn + more);
}

/* sum_k scale_k B_k B_k^T, B_k from a vertex displacement to strains and rotations in Mandel form. */
static void gram(const double alpha[12], const double scale[4], double G[81]) {
    const double h = sqrt(0.5);
    memset(G, 0, 81 * sizeof(double));
    for (int k = 0; k < 4; k++) {
        const double x = alpha[3 * k], y = alpha[3 * k + 1], z = alpha[3 * k + 2];
        const double B[9][3] = {{x, 0, 0},          {0, y, 0},          {0, 0, z},
                                {0, h * z, h * y},  {h * z, 0, h * x},  {h * y, h * x, 0},
                                {0, -h * z, h * y}, {h * z, 0, -h * x}, {-h * y, h * x, 0}};
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) G[9 * i + j] += scale[k] * vdot(B[i], B[j]);
    }
}

/* Returns an upper bound of the largest eigenvalue of a semidefinite A: the root of the trace of a high power; ten
 * squarings, 0.3 %. */
static double largest(double A[81]) {
    double trace[11], P[81];
    int squares = 0;
    for (;; squares++) {
        trace[squares] = 0;
        for (int i = 0; i < 9; i++) trace[squares] += A[10 * i];
        if (!(trace[squares] > 0)) return 0;
        if (squares == 10 || (squares > 0 && trace[squares] > 1 - 1e-13)) break;
        for (int i = 0; i < 81; i++) P[i] = A[i] / trace[squares];
        for (int i = 0; i < 9; i++)
            for (int j = 0; j <= i; j++) {
                double sum = 0;
                for (int k = 0; k < 9; k++) sum += P[9 * i + k] * P[9 * j + k];
                A[9 * i + j] = A[9 * j + i] = sum;
            }
    }
    double root = 1;
    for (; squares > 0; squares--) root = sqrt(trace[squares] * root);
    return trace[0] * root;
}

double tm_corotated_eigenvalue_over(const tm_material_field *field, int32_t tet, const double mass_kg[4]) {
    double scale[4], G[81], L[81], GL[81], A[81];
    for (int k = 0; k < 4; k++) scale[k] = field->mesh->volume_m3[tet] / mass_kg[k];
    gram(field->mesh->shape_1_m + 12 * (int64_t)tet, scale, G);
    factor(tm_field_material(field, tet), tm_field_fibre(field, tet), TM_ROTATION_BAND * field->rotation,
           tm_field_is_smoothed(field, tet), L);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            GL[9 * i + j] = 0;
            for (int k = j; k < 9; k++) GL[9 * i + j] += G[9 * i + k] * L[9 * k + j];
        }
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            A[9 * i + j] = 0;
            for (int k = i; k < 9; k++) A[9 * i + j] += L[9 * k + i] * GL[9 * k + j];
        }
    return CONSERVING * largest(A);
}
