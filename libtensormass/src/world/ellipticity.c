/* Share of the tissue in which its nonlinear law is not elliptic: the acoustic tensor Q_ik = A_ijkl n_j n_l, A =
 * d2W/dF2, has an eigenvalue below 0 for some direction n. There strain concentrates in bands as thin as the mesh
 * allows, and forces fall with each refinement (Ball, Arch. Ration. Mech. Anal. 63 (1976) 337). Tested in 60
 * directions, so that a share is a lower estimate. */
#include <math.h>

#include "base/vec.h"
#include "material/hyperelastic.h"
#include "material/material_internal.h"
#include "tissue/tissue_internal.h"
#include "world/world_internal.h"

enum { DIRECTIONS = 60 };
static const double ROUNDING = 1e-9; /* of the trace */

/* Directions spread evenly over a hemisphere, as a spiral of golden angles. */
static void directions(double n[DIRECTIONS][3]) {
    for (int i = 0; i < DIRECTIONS; i++) {
        const double z = (i + 0.5) / DIRECTIONS, r = sqrt(1 - z * z), angle = 2.399963229728653 * i;
        n[i][0] = r * cos(angle), n[i][1] = r * sin(angle), n[i][2] = z;
    }
}

/* Returns whether a symmetric tensor has no eigenvalue below 0, by its minors. */
static bool is_positive(const double Q[9]) {
    const double slack = ROUNDING * (fabs(Q[0]) + fabs(Q[4]) + fabs(Q[8]));
    const double a = Q[0] + slack, b = Q[4] + slack, c = Q[8] + slack, ab = a * b - Q[1] * Q[1];
    return a > 0 && ab > 0 && c * ab > a * Q[5] * Q[5] + b * Q[2] * Q[2] - 2 * Q[1] * Q[5] * Q[2];
}

static bool is_elliptic(const double A[81], double n[DIRECTIONS][3]) {
    for (int d = 0; d < DIRECTIONS; d++) {
        double Q[9] = {0};
        for (int i = 0; i < 81; i++) Q[i / 27 * 3 + i % 9 / 3] += A[i] * n[d][i / 9 % 3] * n[d][i % 3];
        if (!is_positive(Q)) return false;
    }
    return true;
}

/* A += the bulk modulus' part where it is averaged, as if it were not. Its pressure does not enter Q: J is linear in
 * changes a n^T of F. */
static void add_bulk(const tm_material_field *field, int32_t tet, const double F[9], double A[81]) {
    const double bulk_J = field->mesh->volume_m3[tet] * tm_material_bulk_Pa(tm_field_material(field, tet));
    double cof[9];
    for (int i = 0; i < 3; i++) vcross(F + 3 * ((i + 1) % 3), F + 3 * ((i + 2) % 3), cof + 3 * i);
    const double J = vdot(F, cof);
    if (J < TM_VOLUME_LEAST || J > TM_VOLUME_MOST) return;
    for (int i = 0; i < 81; i++) A[i] += bulk_J * cof[i / 9] * cof[i % 9];
}

static void gradient(const tm_mesh *mesh, int32_t tet, const double *u_m, double F[9]) {
    for (int i = 0; i < 9; i++) F[i] = i % 4 ? 0 : 1;
    for (int k = 0; k < 4; k++) {
        const double *u = u_m + 3 * (int64_t)mesh->tet[4 * (int64_t)tet + k];
        const double *shape = mesh->shape_1_m + 12 * (int64_t)tet + 3 * k;
        for (int i = 0; i < 9; i++) F[i] += u[i / 3] * shape[i % 3];
    }
}

double tm_world_unstable_share(const tm_world *world) {
    TM_REQUIRE(world, "world is null", 0);
    const tm_hyperelastic *hyper = tm_world_hyperelastic(world);
    if (!hyper) return 0;
    const tm_tissue *tissue = world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    const tm_material_field field = tm_tissue_field(tissue);
    double n[DIRECTIONS][3], unstable = 0, whole = 0;
    directions(n);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double A[81], F[9];
        if (!tissue->alive[t]) continue;
        whole += mesh->volume_m3[t];
        if (tm_field_material(&field, t)->law == TM_LAW_LINEAR) continue;
        tm_hyperelastic_hessian(hyper, t, world->state.u_m, A);
        gradient(mesh, t, world->state.u_m, F);
        if (hyper->averaged) add_bulk(&field, t, F, A);
        if (!is_elliptic(A, n)) unstable += mesh->volume_m3[t];
    }
    return whole > 0 ? unstable / whole : 0;
}
