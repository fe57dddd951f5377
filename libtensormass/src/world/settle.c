/* Finds static equilibrium, by dynamic relaxation of K u = f_ext.
 *
 * With forces, loads and supports alone equilibrium is a linear system. The relaxation's mass (the 3x3 vertex tensors),
 * damping and step are chosen anew each step so that the energy falls the most: that choice is the conjugate gradient
 * method. A nonlinear law takes Newton's method (settle_newton.c). With any further constraint (contact) the stages
 * themselves run, under fictitious masses and a damping taken from the motion; with contact of tissue, no faster than
 * its rows look ahead.
 *
 * Over 400 lines: the three ways share one state and its end. */
#include "world/pressure.h"
#include "world/settle_newton.h"
#include "world/vertex_blocks.h"
#include "world/viscosity.h"
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

tm_settle_def tm_settle_def_default(void) {
    return (tm_settle_def){
        .cookie = TM_COOKIE_SETTLE, .size = sizeof(tm_settle_def), .tolerance = 1e-10, .max_steps = 2000000};
}

typedef struct relaxation {
    tm_pool pool;
    tm_world *world;
    const tm_settle_def *def;
    int32_t n;        /* components */
    uint8_t *fixed;   /* [n] prescribed, or without mass */
    double *external; /* [n] */
    double *start_u, *start_u_prev;
    double *residual, *step, *image, *scaled; /* [n] */
    double *inverse; /* [9*vertex_count] linear: inverse vertex tensors of the free components */
    double *mass;    /* [vertex_count] else: fictitious masses, kg per s2 */
    tm_force_scale scale;
    int32_t load_steps;
    int64_t steps;
    double relative, held_friction;
} relaxation;

static double largest(const double *a, const uint8_t *fixed, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++)
        if (!fixed || !fixed[i]) most = fmax(most, fabs(a[i]));
    return most;
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

static void run_phase(tm_world *world, tm_phase phase) {
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

static void find_loads(relaxation *x) { tm_settle_find_loads(x->world, x->external); }

static bool report(relaxation *x) {
    return !x->def->progress || x->steps % 128 || x->def->progress(x->def->user, x->steps, x->relative);
}

static tm_status not_converged(const relaxation *x, tm_error *error) {
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

/* --- linear --- */

/* Inverts the vertex tensor's free part; fixed components get 0. */
static void invert_vertex(const tm_tissue *tissue, int32_t v, const uint8_t *fixed, double inverse[9]) {
    double K[9];
    tm_tissue_vertex_tensor(tissue, v, K);
    for (int i = 0; i < 3; i++) {
        if (!fixed[i]) continue;
        for (int j = 0; j < 3; j++) K[3 * i + j] = K[3 * j + i] = 0;
        K[4 * i] = 1;
    }
    double row[9];
    for (int i = 0; i < 3; i++) vcross(K + 3 * ((i + 1) % 3), K + 3 * ((i + 2) % 3), row + 3 * i);
    const double det = vdot(K, row);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) inverse[3 * i + j] = fixed[i] || fixed[j] ? 0 : row[3 * j + i] / det;
}

/* residual := f_ext - K u on the free components; sets the relative residual. */
static void true_residual(relaxation *x) {
    const double *u = x->world->state.u_m;
    tm_tissue_force(x->world->tissue, u, x->image);
    const double forces = fmax(largest(x->external, NULL, x->n), largest(x->image, NULL, x->n));
    const double reference = fmax(forces, tm_force_scale_at(&x->scale, u, x->n));
    for (int32_t i = 0; i < x->n; i++) x->residual[i] = x->fixed[i] ? 0 : x->external[i] + x->image[i];
    const double most = largest(x->residual, NULL, x->n);
    x->relative = most > 0 ? most / reference : 0;
}

/* One restart of the recurrence: until the recurred residual reaches the tolerance or stops falling. */
static tm_status relax_linear_once(relaxation *x, double reference, tm_error *error) {
    double *u = x->world->state.u_m;
    tm_blocks_apply(x->inverse, x->residual, x->n, x->step);
    double rz = tm_product(x->residual, x->step, x->n);
    while (rz > 0) {
        tm_tissue_force(x->world->tissue, x->step, x->image);
        for (int32_t i = 0; i < x->n; i++)
            if (x->fixed[i]) x->image[i] = 0;
        const double curvature = -tm_product(x->step, x->image, x->n);
        if (!(curvature > 0)) break;
        const double length = rz / curvature;
        for (int32_t i = 0; i < x->n; i++) {
            u[i] += length * x->step[i];
            x->residual[i] += length * x->image[i];
        }
        tm_blocks_apply(x->inverse, x->residual, x->n, x->scaled);
        const double next = tm_product(x->residual, x->scaled, x->n);
        const double carry = next / rz;
        for (int32_t i = 0; i < x->n; i++) x->step[i] = x->scaled[i] + carry * x->step[i];
        rz = next;
        x->relative = largest(x->residual, NULL, x->n) / reference;
        if (++x->steps >= x->def->max_steps || !report(x)) return not_converged(x, error);
        if (!(x->relative > 0.5 * x->def->tolerance)) break;
    }
    return TM_OK;
}

static tm_status relax_linear(relaxation *x, tm_error *error) {
    const tm_tissue *tissue = x->world->tissue;
    for (int32_t v = 0; v < x->n / 3; v++) invert_vertex(tissue, v, x->fixed + 3 * v, x->inverse + 9 * (int64_t)v);
    double best = HUGE_VAL;
    for (int idle = 0;;) {
        true_residual(x);
        if (x->relative <= x->def->tolerance) return TM_OK;
        idle = x->relative < 0.5 * best ? 0 : idle + 1;
        best = fmin(best, x->relative);
        if (!isfinite(x->relative) || idle > 4) return not_converged(x, error);
        const double reference = largest(x->residual, NULL, x->n) / x->relative;
        const tm_status status = relax_linear_once(x, reference, error);
        if (status) return status;
    }
}

/* Linear tissue under pressures: solved anew with their forces at the last solution, until that is one. */
static tm_status relax_pressed(relaxation *x, tm_error *error) {
    enum { ROUNDS = 100 };
    tm_status status = TM_OK;
    for (int round = 0; round < ROUNDS && !status; round++) {
        find_loads(x);
        tm_pressure_add(x->world, x->world->state.u_m, x->external);
        true_residual(x);
        if (round > 0 && x->relative <= 2 * x->def->tolerance) return TM_OK;
        status = relax_linear(x, error);
    }
    return status ? status : not_converged(x, error);
}

/* --- nonlinear tissue --- */

/* Runs Newton's method from the previous state of the tissue to the supports' values, which prepare() has put into
 * u. */
static tm_status relax_corotated(relaxation *x, const tm_settle_def *def, bool turns_only, tm_error *error) {
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

/* Before stages run, moves rotating supports to their targets without contact. If that does not converge, the stages do
 * the rest. */
static void lead(relaxation *x) {
    const size_t bytes = sizeof(double) * (size_t)x->n;
    double *u = x->world->state.u_m;
    tm_settle_def def = *x->def;
    def.tolerance = fmax(def.tolerance, 1e-4);
    if (relax_corotated(x, &def, true, NULL)) {
        memcpy(u, x->start_u, bytes);
        tm_support_impose(x->world, u);
    }
    memcpy(x->world->state.u_prev_m, u, bytes);
}

/* --- with contact --- */

static double stiffening(const tm_tissue *tissue) {
    double most = 1;
    for (int32_t i = 0; i < tissue->material_count; i++) {
        const tm_material *m = tissue->material + i;
        most = fmax(most, tissue->stiffest_Pa[i] / (m->lambda_Pa + 2 * m->mu_Pa));
    }
    return most;
}

/* Increases the masses until no load moves a vertex by more than the world's stride in a step. */
static void slow_down(relaxation *x) {
    const double stride_m = x->world->settle_stride_m;
    double share = 1;
    for (int32_t i = 0; i < x->n && stride_m > 0; i++)
        if (!x->fixed[i] && x->mass[i / 3] > 0) share = fmax(share, fabs(x->external[i]) / (x->mass[i / 3] * stride_m));
    for (int32_t v = 0; v < x->n / 3; v++) x->mass[v] *= share;
}

/* Row sums bound the eigenvalues: with a unit step, mass above a quarter of them is stable. */
static void fictitious_masses(relaxation *x) {
    const tm_tissue *tissue = x->world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    /* Corotated tissue stiffens by less than twice; a nonlinear law by the ratio of its bound to small strains. */
    const double margin = tissue->rotation > 0 ? 2.2 : tissue->stiffest_Pa ? 1.1 * stiffening(tissue) : 1.1;
    double K[9], *sum = x->scaled;
    memset(sum, 0, sizeof(double) * (size_t)x->n);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(tissue, v, K);
        for (int i = 0; i < 9; i++) sum[3 * v + i / 3] += fabs(K[i]);
    }
    for (int32_t p = 0; p < tissue->pair_count; p++) {
        const int32_t *ends = tissue->pair + 2 * (int64_t)p;
        tm_tissue_pair_tensor(tissue, p, K);
        for (int i = 0; i < 9; i++) {
            sum[3 * ends[0] + i / 3] += fabs(K[i]);
            sum[3 * ends[1] + i % 3] += fabs(K[i]);
        }
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        x->mass[v] = margin / 4 * fmax(sum[3 * v], fmax(sum[3 * v + 1], sum[3 * v + 2]));
    slow_down(x);
}

/* Returns the share of the last motion that is carried on: so much that no component goes farther than the world's
 * stride. */
static double carried(const relaxation *x, double damping) {
    const tm_state *s = &x->world->state;
    const double carry = (1 - damping / 2) / (1 + damping / 2), stride_m = x->world->settle_stride_m;
    double most_m = 0;
    for (int32_t i = 0; i < x->n && stride_m > 0; i++) most_m = fmax(most_m, fabs(s->u_m[i] - s->u_prev_m[i]));
    return most_m > stride_m ? fmin(carry, stride_m / most_m) : carry;
}

/* Runs all stages but the integrator, which the relaxation replaces. residual := the complete force, constraints
 * included. */
static void relaxed_pass(relaxation *x, double damping) {
    tm_world *world = x->world;
    tm_state *s = &world->state;
    const double carry = carried(x, damping);
    for (int32_t v = 0; v < x->n / 3; v++)
        world->mobility_s2_kg[v] = x->mass[v] > 0 ? 1 / (x->mass[v] * (1 + damping / 2)) : 0;
    run_phase(world, TM_PHASE_BEGIN);
    run_phase(world, TM_PHASE_FORCE);
    run_phase(world, TM_PHASE_LOAD);
    for (int32_t i = 0; i < x->n; i++)
        s->u_next_m[i] =
            s->u_m[i] + carry * (s->u_m[i] - s->u_prev_m[i]) + world->mobility_s2_kg[i / 3] * s->force_N[i];
    run_phase(world, TM_PHASE_CONSTRAIN);
    for (int32_t i = 0; i < x->n; i++) {
        const double mobility = world->mobility_s2_kg[i / 3];
        const double free_move = s->u_m[i] + carry * (s->u_m[i] - s->u_prev_m[i]);
        x->residual[i] = x->fixed[i] || mobility == 0 ? 0 : (s->u_next_m[i] - free_move) / mobility;
    }
}

/* Returns critical damping of the moving mode: its frequency by Rayleigh's quotient of the last increment. image = the
 * previous residual. */
static double damping_from_motion(const relaxation *x) {
    const tm_state *s = &x->world->state;
    double stiff = 0, heavy = 0;
    for (int32_t i = 0; i < x->n; i++) {
        const double move = s->u_m[i] - s->u_prev_m[i];
        stiff += move * (x->image[i] - x->residual[i]);
        heavy += move * move * x->mass[i / 3];
    }
    const double damping = heavy > 0 && stiff > 0 ? 2 * sqrt(stiff / heavy) : 0;
    return fmin(damping, 1.6);
}

/* Damping in turns. Critical damping of the moving mode is best while one mode moves. But rows that come and go without
 * end look like a fast mode, and its damping holds slow ones: a leaning stack then never comes upright. Momentum that
 * grows until it leads uphill (Nesterov's method with restarts, O'Donoghue and Candes 2015) needs no frequency, but can
 * keep rows coming and going. So whichever makes no progress gives way to the other. */
typedef struct damping_turns {
    double best;            /* least residual so far */
    int64_t improved, turn; /* steps at which it became less, and at which the present damping began */
    bool by_momentum;
    int32_t downhill; /* steps since momentum last led uphill */
} damping_turns;

enum { TURN_STEPS = 1000, IDLE_STEPS = 20000, SLIDING_STEPS = 5000, MOTION_STEPS = 12000 };
static const double NEAR_REST = 1e-7; /* residual at which a motion in time ends */

static double damping_by_momentum(const relaxation *x, damping_turns *d) {
    const tm_state *s = &x->world->state;
    double gain = 0;
    for (int32_t i = 0; i < x->n; i++) gain += x->residual[i] * (s->u_next_m[i] - s->u_m[i]);
    d->downhill = gain < 0 ? 0 : d->downhill + 1;
    return 6.0 / (2.0 * d->downhill + 3.0); /* carries on the share k / (k + 3) after k steps */
}

/* Returns the damping of the next step, from the step just made. */
static double choose_damping(const relaxation *x, damping_turns *d) {
    if (x->relative < 0.9 * d->best) d->best = x->relative, d->improved = x->steps;
    if (x->steps - (d->improved > d->turn ? d->improved : d->turn) > TURN_STEPS)
        d->by_momentum = !d->by_momentum, d->turn = x->steps, d->downhill = 0;
    if (d->by_momentum) return damping_by_momentum(x, d);
    return x->steps ? damping_from_motion(x) : 0;
}

/* Returns an error if a free vertex has moved farther than supports did by more than the mesh is large: contact of
 * tissue does not hold its body. */
static tm_status check_displacement(const relaxation *x, tm_error *error) {
    const double *u = x->world->state.u_m;
    double limit_m = 0;
    for (int32_t i = 0; i < x->n; i++)
        if (x->fixed[i]) limit_m = fmax(limit_m, fabs(u[i]));
    limit_m += x->scale.size_m;
    for (int32_t i = 0; i < x->n; i++) {
        if (x->fixed[i] || fabs(u[i]) <= limit_m) continue;
        const int32_t vertex = tm_mesh_original_vertex(x->world->tissue->mesh, i / 3);
        return tm_fail(error, TM_ERR_SUPPORT, vertex,
                       "no stable rest was found: the body of vertex %d has moved by more than %.3g m, so neither "
                       "supports nor contact hold it; add supports, a body beneath it, or friction to 'touch'",
                       vertex, limit_m);
    }
    return TM_OK;
}

static void find_relative(relaxation *x) {
    const tm_state *s = &x->world->state;
    const double forces = fmax(largest(x->external, NULL, x->n), largest(s->force_N, NULL, x->n));
    x->relative = largest(x->residual, NULL, x->n) / fmax(forces, tm_force_scale_at(&x->scale, s->u_m, x->n));
}

static void advance(relaxation *x) {
    tm_state *s = &x->world->state;
    double *oldest = s->u_prev_m;
    s->u_prev_m = s->u_m;
    s->u_m = s->u_next_m;
    s->u_next_m = oldest;
}

/* Gives up after `idle_steps` without progress. */
static tm_status relax_stages(relaxation *x, int32_t idle_steps, tm_error *error) {
    if (x->world->nonlinear) lead(x);
    fictitious_masses(x);
    damping_turns turns = {.best = HUGE_VAL, .improved = x->steps, .turn = x->steps};
    double damping = 0;
    for (int calm = 0; calm < 3;) {
        relaxed_pass(x, damping);
        find_relative(x);
        if (!isfinite(x->relative) || x->steps - turns.improved > idle_steps) return not_converged(x, error);
        const tm_status status = x->world->settle_stride_m > 0 ? check_displacement(x, error) : TM_OK;
        if (status) return status;
        calm = x->relative <= x->def->tolerance ? calm + 1 : 0;
        damping = choose_damping(x, &turns);
        memcpy(x->image, x->residual, sizeof(double) * (size_t)x->n);
        advance(x);
        if (++x->steps >= x->def->max_steps || !report(x)) return not_converged(x, error);
    }
    return TM_OK;
}

/* Moves bodies as in time, with their masses and the drag of their contact, braked enough for their sway to end soon.
 * Friction holds a leaning stack by its history, and the relaxation's may keep rows coming and going without end. Ends
 * near rest. */
static tm_status move_in_time(relaxation *x, tm_error *error) {
    tm_state *s = &x->world->state;
    const double g_m_s2 = fmax(vnorm(tm_world_gravity_m_s2(x->world)), 1), dt_s = s->dt_s;
    const double damping = fmin(3 * sqrt(g_m_s2 / x->scale.size_m) * dt_s, 1);
    for (int32_t v = 0; v < x->n / 3; v++) x->mass[v] = x->world->tissue->mass_kg[v] / (dt_s * dt_s);
    tm_status status = TM_OK;
    x->relative = HUGE_VAL;
    x->world->settle_drag = true;
    for (int32_t k = 0; k < MOTION_STEPS && !status && x->relative > NEAR_REST; k++) {
        relaxed_pass(x, damping);
        find_relative(x);
        status = check_displacement(x, error);
        advance(x);
        if (++x->steps >= x->def->max_steps || !isfinite(x->relative) || !report(x)) status = not_converged(x, error);
    }
    x->world->settle_drag = false;
    memcpy(s->u_prev_m, s->u_m, sizeof(double) * (size_t)x->n);
    return status;
}

static void keep_stages(tm_world *world, bool recall) {
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (!recall && stage->checkpoint) stage->checkpoint(stage->self);
        if (recall && stage->rollback) stage->rollback(stage->self, world);
    }
}

/* Relaxes bodies that slide on each other. Facets press them sideways, each by another small share, so that they slide
 * far or fall although a user put them where they nearly rest. So they come to rest with a little friction first, near
 * the start, then without. If they do not without, the first rest is the result. */
static tm_status relax_sliding(relaxation *x, tm_error *error) {
    tm_world *world = x->world;
    const size_t bytes = sizeof(double) * (size_t)x->n;
    world->settle_friction = TM_SETTLE_FRICTION;
    const tm_status status = relax_stages(x, IDLE_STEPS, error);
    world->settle_friction = 0;
    if (status) return status;
    const double relative = x->relative;
    memcpy(x->step, world->state.u_m, bytes);
    keep_stages(world, false);
    if (!relax_stages(x, SLIDING_STEPS, NULL)) return TM_OK;
    memcpy(world->state.u_m, x->step, bytes);
    keep_stages(world, true);
    x->relative = relative, x->held_friction = TM_SETTLE_FRICTION;
    return TM_OK;
}

/* Relaxes with contact. Linear bodies that do not come to rest begin again by a motion in time. */
static tm_status relax_held(relaxation *x, tm_error *error) {
    tm_world *world = x->world;
    const bool free = world->settle_stride_m > 0 && !world->nonlinear;
    if (free) keep_stages(world, false);
    const tm_status status = relax_stages(x, IDLE_STEPS, error);
    if (status != TM_ERR_CONVERGENCE || !free || x->steps >= x->def->max_steps) return status;
    keep_stages(world, true);
    memcpy(world->state.u_m, x->start_u, sizeof(double) * (size_t)x->n);
    tm_support_impose(world, world->state.u_m);
    memcpy(world->state.u_prev_m, world->state.u_m, sizeof(double) * (size_t)x->n);
    const tm_status moved = move_in_time(x, error);
    return moved ? moved : relax_stages(x, IDLE_STEPS, error);
}

static bool slides(const tm_world *world) {
    return world->settle_slides && tm_check_constrained(world, NULL, NULL) == TM_ERR_SUPPORT;
}

/* --- both --- */

static bool init(relaxation *x, bool linear) {
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

static void prepare(relaxation *x) {
    tm_state *s = &x->world->state;
    const size_t bytes = sizeof(double) * (size_t)x->n;
    memcpy(x->start_u, s->u_m, bytes);
    memcpy(x->start_u_prev, s->u_prev_m, bytes);
    tm_support_mask(x->world, x->fixed);
    for (int32_t i = 0; i < x->n; i++)
        if (x->world->tissue->mass_kg[i / 3] == 0) x->fixed[i] = 1;
    find_loads(x);
    tm_support_impose(x->world, s->u_m);
    memcpy(s->u_prev_m, s->u_m, bytes);
}

/* Updates forces, reactions and contact to those of the first step from here. */
static void refresh(tm_world *world) {
    tm_world_changed(world);
    for (tm_phase phase = TM_PHASE_BEGIN; phase <= TM_PHASE_CONSTRAIN; phase++) run_phase(world, phase);
}

static tm_status settle(tm_world *world, const tm_settle_def *def, tm_settle_result *result, tm_error *error) {
    relaxation x = {.world = world, .def = def, .n = 3 * world->tissue->mesh->vertex_count};
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
    if (pressed && linear) find_loads(&x);
    if (!status)
        status = !linear   ? (slides(world) ? relax_sliding(&x, error) : relax_held(&x, error))
                 : law     ? relax_corotated(&x, def, false, error)
                 : pressed ? relax_pressed(&x, error)
                           : relax_linear(&x, error);
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
