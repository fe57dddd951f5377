/* One static solution. */
#include "internal.h"

#include <string.h>

static tm_status solve(const tm_solve_def *def, const tms_system *system, const tms_solver *solver, double *u,
                       double *f, tm_error *error) {
    tms_work *work = tms_work_create(solver, 1);
    if (!work) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
    tm_tissue_force(def->tissue, u, f);
    double *b = tms_work_rhs(work);
    for (int32_t i = 0; i < system->n; i++) b[i] = f[system->dof[i]] + (def->load_N ? def->load_N[system->dof[i]] : 0);
    const double *x = tms_work_solve(work);
    for (int32_t i = 0; x && i < system->n; i++) u[system->dof[i]] = x[i];
    tms_work_destroy(work);
    return x ? TM_OK
             : tm_fail(error, TM_ERR_CONVERGENCE, -1,
                       "conjugate gradients did not reach %g in %d iterations; raise cg_max_iterations, or use the "
                       "Cholesky solver",
                       def->cg_tolerance, (int)def->cg_max_iterations);
}

tm_status tm_solve_static(const tm_solve_def *def, double *u_m, double *reaction_N, tm_solve_report *report,
                          tm_error *error) {
    TMS_REQUIRE_PROBLEM(def);
    tm_status checked = tms_check_problem(def, error);
    if (checked != TM_OK) return checked;
    const double start = tms_clock_s();
    const size_t dofs = 3 * (size_t)tm_tissue_mesh(def->tissue)->vertex_count;
    tm_solve_report mine = {.columns = 1};
    tms_system system = {0};
    tms_solver *solver = NULL;
    double *u = tms_take_zeroed(dofs, 8), *f = tms_take(dofs * 8);
    tm_status status =
        u && f ? TM_OK : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
    if (status == TM_OK) status = tms_system_create(def->tissue, def->fixed, &system, error);
    if (status == TM_OK) status = tms_solver_create(&system, def, 0, 0, &solver, &mine, error);
    for (size_t d = 0; status == TM_OK && d < dofs; d++)
        if (def->fixed[d] && def->fixed_value_m) u[d] = def->fixed_value_m[d];
    if (status == TM_OK) status = solve(def, &system, solver, u, f, error);
    if (status == TM_OK && u_m) memcpy(u_m, u, dofs * 8);
    if (status == TM_OK && reaction_N) {
        tm_tissue_force(def->tissue, u, f);
        for (size_t d = 0; d < dofs; d++)
            reaction_N[d] = def->fixed[d] ? -f[d] - (def->load_N ? def->load_N[d] : 0) : 0;
    }
    mine.free_dofs = system.n;
    mine.seconds = tms_clock_s() - start;
    if (report && status == TM_OK) *report = mine;
    tms_solver_destroy(solver);
    tms_system_destroy(&system);
    tms_give(u);
    tms_give(f);
    return status;
}
