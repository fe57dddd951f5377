/* Energy conservation of corotated tissue. Central differences do not conserve the energy of a nonlinear law. Over a
 * step from u to u' they generate e = W' - W + (f + f').(u' - u)/2, the error of the trapezoidal rule for the force's
 * work against its potential W (0 where f is linear in u). At large vibrations, or on slivers whose own step is the
 * guaranteed one, the sum grows without bound, and keeps slivers moving against damping.
 *
 * So generated energy is removed in the next step, and lost energy restored, by stiffness-proportional damping: share
 * g, with g the change of the tissue's force over the last step, which is near -K (u' - u). Its work over the next step
 * is known, share p + share^2 q, and share solves share p + share^2 q + e = 0, within SHARE_MAX. The added force
 * has zero resultant, and is 0 where a body rotates rigidly.
 *
 * All of it follows from u and u_prev, so that a cut tissue continues as a fresh build in the same state does. Only
 * energy that cannot be removed at once is stored, and fades within some hundred steps. Since the work is known, no
 * share adds more than the step lost: it is stable without a bound, unlike a constant share. */
#include "world/conserve.h"

#include <math.h>
#include <string.h>

/* Reached by slivers that invert within a step. With 0.12 a body was off by a tenth of its energy for hundreds of
 * steps; more than 1 gains nothing. With contact the work differs slightly from the predicted one. */
static const double SHARE_MAX = 1;
/* With averaged dilatation W takes extra passes, so conservation is on only below this damping. */
static const double FULL_MAX_1_S = 10;

static double min_damping(const tm_world *world, const tm_ranges *where) {
    const tm_tissue *tissue = world->tissue;
    double least = HUGE_VAL;
    for (int32_t i = 0; world->damped && i < where->count; i++)
        for (int32_t v = where->end[2 * i]; v < where->end[2 * i + 1]; v++)
            if (tissue->mass_kg[v] > 0) least = fmin(least, tissue->damping_kg_s[v] / tissue->mass_kg[v]);
    return least < HUGE_VAL ? least : 0;
}

/* to := from, on the vertices of corotated bodies. */
static void copy(const tm_conserving *c, double *to, const double *from) {
    const tm_ranges *r = c->where;
    for (int32_t i = 0; i < r->count; i++) {
        const int64_t begin = 3 * (int64_t)r->end[2 * i];
        memcpy(to + begin, from + begin, sizeof *to * (size_t)(3 * (int64_t)r->end[2 * i + 1] - begin));
    }
}

static bool are_equal(const tm_conserving *c, const double *a, const double *b) {
    const tm_ranges *r = c->where;
    for (int32_t i = 0; i < r->count; i++) {
        const int64_t begin = 3 * (int64_t)r->end[2 * i];
        if (memcmp(a + begin, b + begin, sizeof *a * (size_t)(3 * (int64_t)r->end[2 * i + 1] - begin))) return false;
    }
    return true;
}

/* to += from */
static void add(const tm_conserving *c, double *to, const double *from) {
    const tm_ranges *r = c->where;
    for (int32_t k = 0; k < r->count; k++)
        for (int64_t i = 3 * (int64_t)r->end[2 * k]; i < 3 * (int64_t)r->end[2 * k + 1]; i++) to[i] += from[i];
}

void tm_conserve_clear(tm_conserving *c) { tm_ranges_clear(c->where, c->now_N); }

/* Computes the tensors' force on the vertices of corotated bodies. */
static void linear_force(const tm_conserving *c, const tm_world *world, const double *u_m, double *force_N) {
    const tm_ranges *r = c->where;
    for (int32_t i = 0; i < r->count; i++)
        tm_force_pass_range(world->tissue->force, &world->tissue->graph, r->end[2 * i], r->end[2 * i + 1], u_m,
                            force_N);
}

bool tm_conserve_init(tm_conserving *c, tm_pool *pool, const tm_world *world, tm_rotation *rotation) {
    const int64_t n = 3 * (int64_t)tm_ranges_length(&rotation->where);
    *c = (tm_conserving){.rotation = rotation, .where = &rotation->where, .last_s = -HUGE_VAL};
    const double damping = min_damping(world, &rotation->where);
    c->on = !tm_nodal_dilatation_is_on(&rotation->nodal_dilatation) || damping < FULL_MAX_1_S;
    c->fades_1_s = damping;
    double **of[] = {&c->now_N, &c->all_N, &c->now_before_N, &c->all_before_N, &c->seen_m, &c->push_N};
    for (int i = 0; i < 6; i++)
        *of[i] = tm_shifted(TM_ALLOC(pool, double, n), sizeof(double), 3 * (int64_t)tm_ranges_first(&rotation->where));
    c->batch_J = TM_ALLOC(pool, double, rotation->batches.count);
    return !pool->failed;
}

typedef struct sums {
    double generated_J, p_J, q_J;
} sums;

/* Computes the energy that the last step generated, without W. Sets push_N to the change of the force, and computes its
 * work in the next step at share 1. */
static void go_over_vertex(tm_conserving *c, const tm_world *world, int32_t v, sums *sum) {
    const tm_state *s = &world->state;
    const double mobility = world->mobility_s2_kg[v], carry = world->damped ? world->inertia[v] : 1;
    for (int32_t i = 3 * v; i < 3 * v + 3; i++) {
        const double came = s->u_m[i] - s->u_prev_m[i], change = c->all_N[i] - c->all_before_N[i];
        const double way = 0.5 * (came + carry * came + mobility * s->force_N[i]);
        c->push_N[i] = change;
        sum->generated_J += 0.5 * (c->now_N[i] + c->now_before_N[i]) * came;
        if (!(mobility > 0)) continue;
        sum->p_J += change * way;
        sum->q_J += 0.5 * mobility * change * change;
    }
}

static sums go_over(tm_conserving *c, const tm_world *world) {
    const tm_ranges *r = c->where;
    sums sum = {0};
    for (int32_t i = 0; i < r->count; i++)
        for (int32_t v = r->end[2 * i]; v < r->end[2 * i + 1]; v++) go_over_vertex(c, world, v, &sum);
    return sum;
}

/* Chooses the share that removes generated_J; the rest stays there and fades as fast as motion is damped. */
static double choose_share(tm_conserving *c, double dt_s, const sums *sum) {
    double share = 0;
    bool all = false;
    if (sum->p_J < 0) {
        const double root = sum->p_J * sum->p_J - 4 * sum->q_J * c->generated_J;
        /* if less can be removed than there is, the largest possible amount */
        const double wanted = root > 0 ? 2 * c->generated_J / (-sum->p_J + sqrt(root)) : -sum->p_J / (2 * sum->q_J);
        share = fmin(fmax(wanted, -SHARE_MAX), SHARE_MAX);
        all = share == wanted && root > 0;
    }
    const double left = c->generated_J + share * (sum->p_J + share * sum->q_J);
    c->generated_J = all ? 0 : fmax(1 - c->fades_1_s * dt_s, 0) * left;
    return share;
}

/* Adds the removing force. Needs all values at u; those at u_prev are stored, or `find_before` computes them. */
static void take_back(tm_conserving *c, tm_world *world, double energy_J,
                      void (*find_before)(tm_conserving *, tm_world *)) {
    tm_state *s = &world->state;
    c->share = 0;
    if (s->time_s == c->last_s) return; /* no step: tissue settles */
    if (!c->valid || !are_equal(c, c->seen_m, s->u_prev_m)) find_before(c, world);
    const sums sum = go_over(c, world);
    c->generated_J += energy_J - c->energy_J + sum.generated_J;
    c->share = choose_share(c, s->dt_s, &sum);
    const tm_ranges *r = c->where;
    for (int32_t k = 0; c->share != 0 && k < r->count; k++)
        for (int64_t i = 3 * (int64_t)r->end[2 * k]; i < 3 * (int64_t)r->end[2 * k + 1]; i++)
            s->force_N[i] += c->push_N[i] *= c->share;
    c->valid = true, c->last_s = s->time_s, c->energy_J = energy_J;
    copy(c, c->now_before_N, c->now_N);
    copy(c, c->all_before_N, c->all_N);
    copy(c, c->seen_m, s->u_m);
}

/* --- correction in addition to the tensors --- */

static double sum_of(const double *partition, int32_t count) {
    double sum = 0;
    for (int32_t n = 0; n < count; n++) sum += partition[n];
    return sum;
}

static void find_correction(tm_conserving *c, tm_world *world) {
    tm_rotation *r = c->rotation;
    const double *u = world->state.u_prev_m;
    tm_ranges_clear(c->where, c->now_before_N);
    r->kernel(&r->batches, r->elastic, r->elastic_count, u, c->now_before_N, c->batch_J);
    c->energy_J = sum_of(c->batch_J, r->elastic_count);
    linear_force(c, world, u, c->all_before_N);
    add(c, c->all_before_N, c->now_before_N);
}

/* Returns whether force_N is the tensors' alone when the stage begins: "force", which sets it, is directly before. */
static bool follows_force(const tm_conserving *c, const tm_world *world) {
    int32_t own = 0;
    while (own < world->stage_count && world->entry[own].stage.self != (void *)c->rotation) own++;
    return own > 0 && own < world->stage_count && !strcmp(world->entry[own - 1].stage.name, "force");
}

void tm_conserve(tm_conserving *c, tm_world *world) {
    double *force = world->state.force_N;
    if (world->evaluating) {
        add(c, force, c->now_N);
        return;
    }
    const double energy_J = sum_of(c->batch_J, c->rotation->list_count);
    if (!follows_force(c, world)) {
        linear_force(c, world, world->state.u_m, c->all_N);
        add(c, c->all_N, c->now_N);
        add(c, force, c->now_N);
    } else {
        add(c, force, c->now_N);
        copy(c, c->all_N, force);
    }
    take_back(c, world, energy_J, find_correction);
}

/* --- complete law --- */

/* Energy without tensors, whose sums differ between forms. */
static double whole_energy(const tm_conserving *c, const double *u) {
    const tm_rotation *r = c->rotation;
    return tm_tet_batches_linear_energy(&r->batches, u) + tm_rotation_sum_energy(&r->batches, u) +
           tm_nodal_dilatation_total_energy(&r->nodal_dilatation, &r->batches, u);
}

/* Computes the force at u_prev, as a step does. */
static void find_whole(tm_conserving *c, tm_world *world) {
    tm_state *s = &world->state, own = *s;
    s->u_m = own.u_prev_m, s->force_N = c->now_before_N;
    tm_ranges_clear(c->where, c->now_before_N);
    tm_relaxing_force(c->rotation->whole);
    *s = own;
    copy(c, c->all_before_N, c->now_before_N);
    c->energy_J = whole_energy(c, own.u_prev_m);
}

void tm_conserve_whole(tm_conserving *c, tm_world *world) {
    double *force = world->state.force_N;
    if (!c->on || world->evaluating) {
        tm_relaxing_force(c->rotation->whole);
        return;
    }
    copy(c, c->push_N, force);
    tm_ranges_clear(c->where, force);
    tm_relaxing_force(c->rotation->whole);
    copy(c, c->now_N, force);
    copy(c, c->all_N, force);
    add(c, force, c->push_N);
    take_back(c, world, whole_energy(c, world->state.u_m), find_whole);
}

/* --- snapshot, checkpoint, rollback --- */

int64_t tm_conserve_snapshot(const tm_conserving *c, void *buffer) {
    if (buffer) memcpy(buffer, &c->generated_J, sizeof c->generated_J);
    return sizeof c->generated_J;
}

bool tm_conserve_restore(tm_conserving *c, const void *buffer, int64_t bytes, bool apply) {
    if (bytes != sizeof c->generated_J) return false;
    if (!apply) return true;
    memcpy(&c->generated_J, buffer, sizeof c->generated_J);
    tm_conserve_restart(c);
    return true;
}

void tm_conserve_restart(tm_conserving *c) { c->valid = false, c->last_s = -HUGE_VAL; }
void tm_conserve_checkpoint(tm_conserving *c) { c->saved_generated_J = c->generated_J; }
void tm_conserve_rollback(tm_conserving *c) {
    c->generated_J = c->saved_generated_J;
    tm_conserve_restart(c);
}
