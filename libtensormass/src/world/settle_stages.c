/* Settles with the stages themselves, contact included: dynamic relaxation under fictitious masses and a damping taken
 * from the motion. With contact of tissue, no faster than its rows look ahead. */
#include "world/settle_internal.h"

#include <math.h>
#include <string.h>

/* Before stages run, moves rotating supports to their targets without contact. If that does not converge, the stages do
 * the rest. */
static void lead(tm_relaxation *x) {
    const size_t bytes = sizeof(double) * (size_t)x->n;
    double *u = x->world->state.u_m;
    tm_settle_def def = *x->def;
    def.tolerance = fmax(def.tolerance, 1e-4);
    if (tm_settle_nonlinear(x, &def, true, NULL)) {
        memcpy(u, x->start_u, bytes);
        tm_support_impose(x->world, u);
    }
    memcpy(x->world->state.u_prev_m, u, bytes);
}

static double stiffening(const tm_tissue *tissue) {
    double most = 1;
    for (int32_t i = 0; i < tissue->material_count; i++) {
        const tm_material *m = tissue->material + i;
        most = fmax(most, tissue->stiffest_Pa[i] / (m->lambda_Pa + 2 * m->mu_Pa));
    }
    return most;
}

/* Increases the masses until no load moves a vertex by more than the world's stride in a step. */
static void slow_down(tm_relaxation *x) {
    const double stride_m = x->world->settle_stride_m;
    double share = 1;
    for (int32_t i = 0; i < x->n && stride_m > 0; i++)
        if (!x->fixed[i] && x->mass[i / 3] > 0) share = fmax(share, fabs(x->external[i]) / (x->mass[i / 3] * stride_m));
    for (int32_t v = 0; v < x->n / 3; v++) x->mass[v] *= share;
}

/* Row sums bound the eigenvalues: with a unit step, mass above a quarter of them is stable. */
static void fictitious_masses(tm_relaxation *x) {
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
static double carried(const tm_relaxation *x, double damping) {
    const tm_state *s = &x->world->state;
    const double carry = (1 - damping / 2) / (1 + damping / 2), stride_m = x->world->settle_stride_m;
    double most_m = 0;
    for (int32_t i = 0; i < x->n && stride_m > 0; i++) most_m = fmax(most_m, fabs(s->u_m[i] - s->u_prev_m[i]));
    return most_m > stride_m ? fmin(carry, stride_m / most_m) : carry;
}

/* Runs all stages but the integrator, which the relaxation replaces. residual := the complete force, constraints
 * included. */
static void relaxed_pass(tm_relaxation *x, double damping) {
    tm_world *world = x->world;
    tm_state *s = &world->state;
    const double carry = carried(x, damping);
    for (int32_t v = 0; v < x->n / 3; v++)
        world->mobility_s2_kg[v] = x->mass[v] > 0 ? 1 / (x->mass[v] * (1 + damping / 2)) : 0;
    tm_settle_run_phase(world, TM_PHASE_BEGIN);
    tm_settle_run_phase(world, TM_PHASE_FORCE);
    tm_settle_run_phase(world, TM_PHASE_LOAD);
    for (int32_t i = 0; i < x->n; i++)
        s->u_next_m[i] =
            s->u_m[i] + carry * (s->u_m[i] - s->u_prev_m[i]) + world->mobility_s2_kg[i / 3] * s->force_N[i];
    tm_settle_run_phase(world, TM_PHASE_CONSTRAIN);
    for (int32_t i = 0; i < x->n; i++) {
        const double mobility = world->mobility_s2_kg[i / 3];
        const double free_move = s->u_m[i] + carry * (s->u_m[i] - s->u_prev_m[i]);
        x->residual[i] = x->fixed[i] || mobility == 0 ? 0 : (s->u_next_m[i] - free_move) / mobility;
    }
}

/* Returns critical damping of the moving mode: its frequency by Rayleigh's quotient of the last increment. image = the
 * previous residual. */
static double damping_from_motion(const tm_relaxation *x) {
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

static double damping_by_momentum(const tm_relaxation *x, damping_turns *d) {
    const tm_state *s = &x->world->state;
    double gain = 0;
    for (int32_t i = 0; i < x->n; i++) gain += x->residual[i] * (s->u_next_m[i] - s->u_m[i]);
    d->downhill = gain < 0 ? 0 : d->downhill + 1;
    return 6.0 / (2.0 * d->downhill + 3.0); /* carries on the share k / (k + 3) after k steps */
}

/* Returns the damping of the next step, from the step just made. */
static double choose_damping(const tm_relaxation *x, damping_turns *d) {
    if (x->relative < 0.9 * d->best) d->best = x->relative, d->improved = x->steps;
    if (x->steps - (d->improved > d->turn ? d->improved : d->turn) > TURN_STEPS)
        d->by_momentum = !d->by_momentum, d->turn = x->steps, d->downhill = 0;
    if (d->by_momentum) return damping_by_momentum(x, d);
    return x->steps ? damping_from_motion(x) : 0;
}

/* Returns an error if a free vertex has moved farther than supports did by more than the mesh is large: contact of
 * tissue does not hold its body. */
static tm_status check_displacement(const tm_relaxation *x, tm_error *error) {
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

static void find_relative(tm_relaxation *x) {
    const tm_state *s = &x->world->state;
    const double forces = fmax(tm_settle_largest(x->external, NULL, x->n), tm_settle_largest(s->force_N, NULL, x->n));
    x->relative = tm_settle_largest(x->residual, NULL, x->n) / fmax(forces, tm_force_scale_at(&x->scale, s->u_m, x->n));
}

static void advance(tm_relaxation *x) {
    tm_state *s = &x->world->state;
    double *oldest = s->u_prev_m;
    s->u_prev_m = s->u_m;
    s->u_m = s->u_next_m;
    s->u_next_m = oldest;
}

/* Gives up after `idle_steps` without progress. */
static tm_status relax_stages(tm_relaxation *x, int32_t idle_steps, tm_error *error) {
    if (x->world->nonlinear) lead(x);
    fictitious_masses(x);
    damping_turns turns = {.best = HUGE_VAL, .improved = x->steps, .turn = x->steps};
    double damping = 0;
    for (int calm = 0; calm < 3;) {
        relaxed_pass(x, damping);
        find_relative(x);
        if (!isfinite(x->relative) || x->steps - turns.improved > idle_steps) return tm_settle_not_converged(x, error);
        const tm_status status = x->world->settle_stride_m > 0 ? check_displacement(x, error) : TM_OK;
        if (status) return status;
        calm = x->relative <= x->def->tolerance ? calm + 1 : 0;
        damping = choose_damping(x, &turns);
        memcpy(x->image, x->residual, sizeof(double) * (size_t)x->n);
        advance(x);
        if (++x->steps >= x->def->max_steps || !tm_settle_goes_on(x)) return tm_settle_not_converged(x, error);
    }
    return TM_OK;
}

/* Moves bodies as in time, with their masses and the drag of their contact, braked enough for their sway to end soon.
 * Friction holds a leaning stack by its history, and the relaxation's may keep rows coming and going without end. Ends
 * near rest. */
static tm_status move_in_time(tm_relaxation *x, tm_error *error) {
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
        if (++x->steps >= x->def->max_steps || !isfinite(x->relative) || !tm_settle_goes_on(x))
            status = tm_settle_not_converged(x, error);
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
static tm_status relax_sliding(tm_relaxation *x, tm_error *error) {
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
static tm_status relax_held(tm_relaxation *x, tm_error *error) {
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

tm_status tm_settle_stages(tm_relaxation *x, tm_error *error) {
    return slides(x->world) ? relax_sliding(x, error) : relax_held(x, error);
}
