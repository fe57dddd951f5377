/* Largest eigenvalues of single tetrahedra, on which critical steps stand (Irons). */
#include "material/law.h"
#include "tissue/tissue_internal.h"

#include <math.h>

/* K_e = V B^T C B and M_e = rho V/4: the eigenvalues are 4/rho times those of L^T (B B^T) L, C = L L^T. */
double tm_element_eigenvalue_above(const tm_tissue *tissue, int32_t tet, double floor) {
    const tm_material *material = tm_tissue_tet_material(tissue, tet);
    const tm_material_field field = tm_tissue_field(tissue);
    double G[36] = {0}, A[36];
    if (!tm_law_of(&field)->has_constant_tangent) {
        const double mass = material->density_kg_m3 * tissue->mesh->volume_m3[tet] / 4;
        return tm_law_of(&field)->bound(&field, tet, (const double[4]){mass, mass, mass, mass});
    }
    for (int k = 0; k < 4; k++) tm_strain_gram_add(tissue->mesh->shape_1_m + 12 * (int64_t)tet + 3 * k, 1, G);
    const double scale = 4 / material->density_kg_m3;
    double trace = 0;
    for (int i = 0; i < 6; i++) trace += G[7 * i];
    if (!tissue->smoothed && scale * trace * tm_material_stiffest_Pa(material) <= floor) return 0;
    tm_linear_gram(&field, tet, G, A);
    tm_diagonalise6(A);
    double most = 0;
    for (int i = 0; i < 6; i++) most = fmax(most, A[7 * i]);
    return scale * most;
}

double tm_element_eigenvalue_over(const tm_tissue *tissue, int32_t tet, const double mass_kg[4]) {
    const tm_material_field field = tm_tissue_field(tissue);
    return tm_law_of(&field)->bound(&field, tet, mass_kg);
}

double tm_element_eigenvalue(const tm_tissue *tissue, int32_t tet) {
    return tm_element_eigenvalue_above(tissue, tet, 0);
}
