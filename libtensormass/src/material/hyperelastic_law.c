/* The rows of nonlinear laws: all share passes, tangents and the form of the bound (hyperelastic.c). */
#include <math.h>

#include "base/vec.h"
#include "material/law.h"

static bool averages(const tm_law_state *s) { return tm_nodal_dilatation_is_on(&s->averages); }

static void evaluate(const tm_law_state *s, bool plain, const double *u_m) {
    tm_hyperelastic_evaluate(&s->hyper, &s->work, &s->averages, plain, u_m);
}

static double energy(const tm_law_state *s, const double *u_m) {
    const double own_J = tm_hyperelastic_energy(&s->hyper, u_m);
    if (!averages(s)) return own_J;
    evaluate(s, true, u_m);
    return own_J + tm_nodal_dilatation_stored(&s->averages);
}

static void force(const tm_law_state *s, bool plain, const double *u_m, double *force_N) {
    tm_hyperelastic_corners(&s->hyper, &s->work, &s->averages, plain, u_m);
    tm_law_gather(s, force_N);
}

/* P += the change of the tetrahedron's averaged pressure and of its dilatation's slope. */
static void add_averaged(const tm_law_state *s, int32_t tet, const double *u_m, const double D[9], double P[9]) {
    const tm_nodal_dilatation *a = &s->averages;
    double A[81], slope[9], pressure = 0, change = 0;
    for (int k = 0; k < 4; k++) {
        pressure += a->corotated_Pa[a->domain[4 * (int64_t)tet + k]];
        change += a->linear_Pa[a->domain[4 * (int64_t)tet + k]];
    }
    tm_law_slope(a, tet, slope);
    tm_hyperelastic_dilatation_hessian(&s->hyper, tet, u_m, A);
    for (int i = 0; i < 81; i++) P[i / 9] += a->quarter_m3[tet] * pressure * A[i] * D[i % 9];
    for (int i = 0; i < 9; i++) P[i] += a->quarter_m3[tet] * change * slope[i];
}

static void tangent(const tm_law_state *s, const double *u_m, const double *d_m, double *change_N) {
    const tm_mesh *mesh = s->field.mesh;
    if (averages(s)) {
        evaluate(s, true, u_m);
        tm_law_change_pressures(s, d_m);
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double A[81], D[9], P[9] = {0};
        if (!s->field.alive[t]) continue;
        tm_law_gradient(mesh, t, d_m, D);
        tm_hyperelastic_hessian(&s->hyper, t, u_m, A);
        for (int i = 0; i < 81; i++) P[i / 9] += A[i] * D[i % 9];
        if (averages(s)) add_averaged(s, t, u_m, D, P);
        tm_law_add_stress(mesh, t, P, change_N);
    }
}

/* K_e = V sum alpha_k.A.alpha_l is at most that of A = a 1, whose eigenvalues are those of a V sum alpha_k
 * alpha_k^T/m_k. */
static double bound(const tm_material_field *field, int32_t tet, const double mass_kg[4]) {
    const double *alpha = field->mesh->shape_1_m + 12 * (int64_t)tet;
    double G[9] = {0};
    if (tm_field_material(field, tet)->law == TM_LAW_LINEAR) return tm_law_linear.bound(field, tet, mass_kg);
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 9; i++) G[i] += alpha[3 * k + i / 3] * alpha[3 * k + i % 3] / mass_kg[k];
    for (int sweep = 0; sweep < 8; sweep++)
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) tm_jacobi(G, 3, p, q, &(double){0}, &(double){0});
    const double most = fmax(G[0], fmax(G[4], G[8]));
    return field->stiffest_Pa[field->region_material[field->mesh->region[tet]]] * field->mesh->volume_m3[tet] * most;
}

#define ROW(NAME, file)                                                                                                \
    const tm_law tm_law_##file = {.name = #file,                                                                       \
                                  .kind = TM_LAW_##NAME,                                                               \
                                  .is_objective = true,                                                                \
                                  .energy = energy,                                                                    \
                                  .force = force,                                                                      \
                                  .tangent = tangent,                                                                  \
                                  .bound = bound};
TM_NONLINEAR_LAWS(ROW)
