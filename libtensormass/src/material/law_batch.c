/* Functions shared by the rows of the table of laws: force by the passes over batches, gradients and stresses of one
 * tetrahedron. */
#include "base/vec.h"
#include "material/law.h"

void tm_law_batch_force(const tm_law_state *state, bool plain, const double *u_m, double *force_N) {
    const tm_viscous_passes passes = tm_viscous_choose(plain);
    const tm_nodal_dilatation *averages = tm_nodal_dilatation_is_on(&state->averages) ? &state->averages : NULL;
    passes.strain(&state->batches, &state->work, averages, 0, state->batches.count, u_m);
    if (averages) {
        tm_nodal_dilatation_average(averages, NULL, 0, tm_nodal_dilatation_domains(averages));
        passes.pressure(&state->batches, &state->work, averages, 0, state->batches.count);
    }
    tm_law_gather(state, force_N);
}

void tm_law_gather(const tm_law_state *state, double *force_N) {
    const tm_mesh *mesh = state->field.mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const double *corner = state->work.corner_N + 12 * TM_LANES * (int64_t)(t / TM_LANES) + t % TM_LANES;
        for (int i = 0; i < 12; i++)
            force_N[3 * (int64_t)mesh->tet[4 * (int64_t)t + i / 3] + i % 3] -= corner[TM_LANES * i];
    }
}

void tm_law_gradient(const tm_mesh *mesh, int32_t tet, const double *u_m, double H[9]) {
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    for (int i = 0; i < 9; i++) {
        H[i] = 0;
        for (int k = 0; k < 4; k++)
            H[i] += u_m[3 * (int64_t)mesh->tet[4 * (int64_t)tet + k] + i / 3] * alpha[3 * k + i % 3];
    }
}

void tm_law_add_stress(const tm_mesh *mesh, int32_t tet, const double P[9], double *force_N) {
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            force_N[3 * (int64_t)mesh->tet[4 * (int64_t)tet + k] + i] -= vdot(P + 3 * i, alpha + 3 * k);
}
