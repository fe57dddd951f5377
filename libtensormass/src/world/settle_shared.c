/* What the ways of settling share: norm, loads, Newton's method from the start to the supports' values, and errors. */
#include "world/pressure.h"
#include "world/settle_internal.h"

#include <math.h>
#include <string.h>

double tm_settle_largest(const double *a, const uint8_t *fixed, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++)
        if (!fixed || !fixed[i]) most = fmax(most, fabs(a[i]));
    return most;
}

void tm_settle_run_phase(tm_world *world, tm_phase phase) {
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (stage->phase == phase && !stage->skip_in_settle) tm_stage_do(stage, world);
    }
}

void tm_settle_find_loads(tm_world *world, double *external_N) {
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    memset(world->state.force_N, 0, bytes);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (stage->phase == TM_PHASE_LOAD && !stage->skip_in_settle && stage->range != tm_stage_pressure_run)
            tm_stage_do(stage, world);
    }
    memcpy(external_N, world->state.force_N, bytes);
}

bool tm_settle_goes_on(const tm_relaxation *x) {
    return !x->def->progress || x->steps % 128 || x->def->progress(x->def->user, x->steps, x->relative);
}

tm_status tm_settle_not_converged(const tm_relaxation *x, tm_error *error) {
    if (x->world->settle_stride_m > 0)
        return tm_fail(
            error, TM_ERR_CONVERGENCE, -1,
            "no stable rest was found: the residual is %g after %lld steps, above the tolerance of %g; bodies that "
            "contact alone holds may slide or tip: add friction to 'touch' or supports, or allow a larger tolerance",
            x->relative, (long long)x->steps, x->def->tolerance);
    return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                   "the residual is %g after %lld steps, above the tolerance of %g; allow more steps or a larger "
                   "tolerance, or add supports",
                   x->relative, (long long)x->steps, x->def->tolerance);
}

/* Runs Newton's method from the previous state of the tissue to the supports' values, which prepare() has put into
 * u. */
tm_status tm_settle_nonlinear(tm_relaxation *x, const tm_settle_def *def, bool turns_only, tm_error *error) {
    double *u = x->world->state.u_m, *target = x->scaled;
    const size_t bytes = sizeof(double) * (size_t)x->n;
    tm_settle_result result = {0};
    memcpy(target, u, bytes);
    memcpy(u, x->start_u, bytes);
    const tm_newton_rest rest = {
        .fixed = x->fixed, .external_N = x->external, .target_m = target, .turns_only = turns_only};
    const tm_status status = tm_settle_newton(x->world, &rest, def, u, &result, error);
    x->steps = result.steps, x->relative = result.residual, x->load_steps = result.load_steps;
    tm_support_impose(x->world, u);
    return status;
}
