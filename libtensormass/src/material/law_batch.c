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

void tm_law_slope(const tm_nodal_dilatation *a, int32_t tet, double slope[9]) {
    const double *lane = a->rotation + 9 * TM_LANES * (int64_t)(tet / TM_LANES) + tet % TM_LANES;
    for (int i = 0; i < 9; i++) slope[i] = lane[TM_LANES * i];
}

void tm_law_change_pressures(const tm_law_state *s, const double *d_m) {
    const tm_nodal_dilatation *a = &s->averages;
    const tm_domains *domains = tm_nodal_dilatation_domains_of(a);
    for (int32_t t = 0; t < s->field.mesh->tet_count; t++) {
        double D[9], slope[9], sum = 0;
        tm_law_gradient(s->field.mesh, t, d_m, D);
        tm_law_slope(a, t, slope);
        for (int i = 0; i < 9; i++) sum += slope[i] * D[i];
        a->linear_dilatation[t] = s->field.alive[t] ? a->quarter_m3[t] * sum : 0;
    }
    for (int32_t i = 0; i < domains->count; i++) {
        double sum = 0;
        for (int32_t j = a->tet_at[i]; j < a->tet_at[i + 1]; j++) sum += a->linear_dilatation[a->tet[j]];
        const bool grows = domains->volume_m3[i] > 0 && tm_nodal_dilatation_grows(a, i, domains->law[i]);
        a->linear_Pa[i] = grows ? a->bulk_Pa[domains->law[i]] * sum / domains->volume_m3[i] : 0;
    }
}
