/* Rotation of the tissue around a vertex, with which compliance turns between two factors. */
#include "factored.h"

#include <math.h>
#include <string.h>

/* Adds a tetrahedron's grad u times its volume. */
static void add_gradient(const tm_mesh *mesh, int32_t tet, const double *u_m, double H[9]) {
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    for (int k = 0; k < 4; k++) {
        const double *u = u_m + 3 * (int64_t)mesh->tet[4 * (int64_t)tet + k];
        for (int i = 0; i < 9; i++) H[i] += mesh->volume_m3[tet] * u[i / 3] * alpha[3 * k + i % 3];
    }
}

/* C := the cofactors of F: det F times the inverse transposed. */
static double cofactors(const double F[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            C[3 * i + j] = F[3 * a + c] * F[3 * b + d] - F[3 * a + d] * F[3 * b + c];
        }
    return F[0] * C[0] + F[1] * C[1] + F[2] * C[2];
}

/* Iterates R := mean of R and its inverse transposed, until it is orthogonal (Higham 1986). Returns false for an
 * inverted or nearly flat R: its rotation is undefined. */
static bool polar(double R[9]) {
    enum { ITERATIONS = 12 };
    const double least = 0.05; /* of the volume */
    for (int k = 0; k < ITERATIONS; k++) {
        double C[9], change = 0;
        const double det = cofactors(R, C);
        if (!(det > least)) return false;
        for (int i = 0; i < 9; i++) {
            const double next = 0.5 * (R[i] + C[i] / det);
            change = fmax(change, fabs(next - R[i]));
            R[i] = next;
        }
        if (change < 1e-12) break;
    }
    return true;
}

/* Sums volume and grad u times volume of the active tetrahedra around a vertex. */
static double add_around(const tm_mesh *mesh, const uint8_t *alive, const double *u_m, int32_t vertex, double H[9]) {
    double volume = 0;
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i];
        if (!alive[t]) continue;
        add_gradient(mesh, t, u_m, H);
        volume += mesh->volume_m3[t];
    }
    return volume;
}

static bool mean_rotation(double volume, double R[9]) {
    for (int i = 0; i < 9; i++) R[i] = (volume > 0 ? R[i] / volume : 0) + (i % 4 == 0);
    return polar(R);
}

void tms_vertex_frame(const tm_mesh *mesh, const uint8_t *alive, const double *u_m, int32_t vertex, double R[9]) {
    static const double unit[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    memset(R, 0, 9 * sizeof *R);
    if (mean_rotation(add_around(mesh, alive, u_m, vertex, R), R)) return;
    double volume = 0; /* crushed, for instance between jaws: uses its neighbours */
    memset(R, 0, 9 * sizeof *R);
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++)
        for (int k = 0; k < 4 && alive[mesh->vertex_tet[i]]; k++)
            volume += add_around(mesh, alive, u_m, mesh->tet[4 * (int64_t)mesh->vertex_tet[i] + k], R);
    if (!mean_rotation(volume, R)) memcpy(R, unit, sizeof unit);
}
