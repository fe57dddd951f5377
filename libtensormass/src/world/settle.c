/* Finds static equilibrium, by dynamic relaxation of K u = f_ext.
 *
 * With forces, loads and supports alone equilibrium is a linear system (settle_linear.c). A nonlinear law takes
 * Newton's method (settle_newton.c). With any further constraint (contact) the stages themselves run (settle_stages.c).
 * This file chooses among them. */
#include "world/pressure.h"
#include "world/settle_internal.h"
#include "world/viscosity.h"

#include <math.h>
#include <string.h>

tm_settle_def tm_settle_def_default(void) {
    return (tm_settle_def){
        .cookie = TM_COOKIE_SETTLE, .size = sizeof(tm_settle_def), .tolerance = 1e-10, .max_steps = 2000000};
}

static bool known(const tm_world *world, const tm_stage *stage) {
    return stage->range == tm_stage_force || stage->range == tm_stage_integrate ||
           stage->range == tm_stage_integrate_damped || stage->range == tm_stage_gravity_run ||
           stage->range == tm_stage_load_run || stage->range == tm_stage_pressure_run ||
           stage->range == tm_stage_support_run || (world->nonlinear && stage->self == world->nonlinear->self) ||
           tm_stage_is_viscosity(stage);
}

bool tm_settle_is_linear(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!known(world, &world->entry[i].stage)) return false;
    return true;
}

static bool init(tm_relaxation *x, bool linear) {
    const int64_t n = x->n;
    x->fixed = TM_ALLOC(&x->pool, uint8_t, n);
    x->external = TM_ALLOC(&x->pool, double, n);
    x->start_u = TM_ALLOC(&x->pool, double, n);
    x->start_u_prev = TM_ALLOC(&x->pool, double, n);
    x->residual = TM_ALLOC(&x->pool, double, n);
    x->step = TM_ALLOC(&x->pool, double, n);
    x->image = TM_ALLOC(&x->pool, double, n);
    x->scaled = TM_ALLOC(&x->pool, double, n);
    if (linear)
        x->inverse = TM_ALLOC(&x->pool, double, 3 * n);
    else
        x->mass = TM_ALLOC(&x->pool, double, n / 3);
    return !x->pool.failed;
}

static void prepare(tm_relaxation *x) {
    tm_state *s = &x->world->state;
    const size_t bytes = sizeof(double) * (size_t)x->n;
    memcpy(x->start_u, s->u_m, bytes);
    memcpy(x->start_u_prev, s->u_prev_m, bytes);
    tm_support_mask(x->world, x->fixed);
    for (int32_t i = 0; i < x->n; i++)
        if (x->world->tissue->mass_kg[i / 3] == 0) x->fixed[i] = 1;
    tm_settle_find_loads(x->world, x->external);
    tm_support_impose(x->world, s->u_m);
    memcpy(s->u_prev_m, s->u_m, bytes);
}

/* Updates forces, reactions and contact to those of the first step from here. */
static void refresh(tm_world *world) {
    tm_world_changed(world);
    for (tm_phase phase = TM_PHASE_BEGIN; phase <= TM_PHASE_CONSTRAIN; phase++) tm_settle_run_phase(world, phase);
}

static tm_status settle(tm_world *world, const tm_settle_def *def, tm_settle_result *result, tm_error *error) {
    tm_relaxation x = {.world = world, .def = def, .n = 3 * world->tissue->mesh->vertex_count};
    x.scale = tm_force_scale_of(world->tissue);
    const tm_nonlinear *law = world->nonlinear;
    const bool linear = tm_settle_is_linear(world);
    if (!init(&x, linear)) {
        tm_pool_release(&x.pool);
        return tm_fail_memory(error, "settling");
    }
    prepare(&x);
    const bool pressed = tm_world_has_pressure(world);
    if (pressed && linear) tm_pressure_add(world, world->state.u_m, x.external);
    tm_status status = linear ? tm_check_constrained(world, x.external, error) : TM_OK;
    if (pressed && linear) tm_settle_find_loads(world, x.external);
    if (!status)
        status = !linear ? tm_settle_stages(&x, error)
                 : law   ? tm_settle_nonlinear(&x, def, false, error)
                         : tm_settle_linear(&x, pressed, error);
    tm_state *s = &world->state;
    const size_t bytes = sizeof(double) * (size_t)x.n;
    memcpy(s->u_m, status ? x.start_u : s->u_m, status ? bytes : 0);
    memcpy(s->u_prev_m, status ? x.start_u_prev : s->u_m, bytes);
    world->settle_friction = x.held_friction;
    refresh(world);
    world->settle_friction = 0;
    if (result)
        *result = (tm_settle_result){.steps = x.steps,
                                     .residual = x.relative,
                                     .energy_J = tm_tissue_energy(world->tissue, s->u_m),
                                     .load_steps = x.load_steps,
                                     .held_friction = x.held_friction,
                                     .deformation = tm_tissue_deformation(world->tissue, s->u_m)};
    if (result && law) result->energy_J += law->energy(law->self, s->u_m);
    tm_pool_release(&x.pool);
    return status;
}

tm_status tm_world_settle(tm_world *world, const tm_settle_def *def, tm_settle_result *result, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_SETTLE, TM_ERR_ARGUMENT);
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    if (!(def->tolerance > 0) || def->max_steps < 1)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "tolerance %g, %lld steps; give positive numbers", def->tolerance,
                       (long long)def->max_steps);
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.settle_refusal)
            return tm_fail(error, TM_ERR_ARGUMENT, -1, "settling: stage %s: %s", world->entry[i].stage.name,
                           world->entry[i].stage.settle_refusal);
    const tm_mesh *mesh = world->tissue->mesh;
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++)
        if (!tm_is_place(world->state.u_m[i]) || !tm_is_place(world->state.u_prev_m[i]))
            return tm_fail(
                error, TM_ERR_ARGUMENT, tm_mesh_original_vertex(mesh, i / 3),
                "vertex %d: its displacement is %g m now and %g m one step before; start from finite displacements",
                tm_mesh_original_vertex(mesh, i / 3), world->state.u_m[i], world->state.u_prev_m[i]);
    tm_relaxed relaxed = {0};
    tm_status status = tm_relaxed_begin(world, &relaxed, error);
    world->settling = true;
    if (!status) status = settle(world, def, result, error);
    world->settling = false;
    tm_relaxed_end(world, &relaxed, !status);
    return status;
}
