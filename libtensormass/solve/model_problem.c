/* Builds the static problem of a tm_model_def. */
#include "model_problem.h"

tm_status tms_problem_build(const tm_model_def *def, const tm_tissue *whole, tms_problem *p, tm_solve_def *solve,
                            tm_error *error) {
    const int32_t vertices = tm_tissue_mesh(whole)->vertex_count;
    const size_t n = 3 * (size_t)vertices;
    if (def->tissue.scaled_step_s > 0)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "mass scaling needs a time step, and the quasi-static part has none; leave mass scaling out");
    *p = (tms_problem){tms_alloc_zeroed(n, 1), tms_alloc_zeroed(n, 8), tms_alloc_zeroed(n, 8)};
    if (!p->fixed || !p->value_m || !p->load_N)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the static problem; use a coarser mesh");
    for (int32_t i = 0; i < def->support_count; i++) {
        const int32_t dof = def->support_dof[i];
        if (dof < 0 || (size_t)dof >= n)
            return tm_fail(error, TM_ERR_ARGUMENT, i,
                           "supported component %d is outside 0 to %zu; give 3*vertex + axis", (int)dof, n);
        p->fixed[dof] = 1;
        p->value_m[dof] = def->support_m[i];
    }
    const double *mass = tm_tissue_mass_kg(whole);
    for (size_t d = 0; d < n; d++)
        p->load_N[d] =
            (def->load_N ? def->load_N[d] : 0) + mass[d / 3] * (def->gravity_m_s2 ? def->gravity_m_s2[d % 3] : 0);
    solve->tissue = whole;
    solve->fixed = p->fixed;
    solve->fixed_value_m = p->value_m;
    solve->load_N = p->load_N;
    return TM_OK;
}

void tms_problem_free(tms_problem *p) {
    tms_free(p->fixed);
    tms_free(p->value_m);
    tms_free(p->load_N);
    *p = (tms_problem){0};
}

tm_status tms_invalid_member(const tm_model_def *def, const char *member, tm_status status) {
    if (status != TM_OK && def->invalid_member && !*def->invalid_member) *def->invalid_member = member;
    return status;
}
