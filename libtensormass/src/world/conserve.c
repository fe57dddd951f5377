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

#include <float.h>
#include <math.h>
#include <string.h>

/* Reached by slivers that invert within a step. With 0.12 a body was off by a tenth of its energy for hundreds of
 * steps; more than 1 gains nothing. With contact the work differs slightly from the predicted one. */
static const double SHARE_MAX = 1;
/* With averaged dilatation W takes extra passes, so conservation is on only below this damping. */
static const double FULL_MAX_1_S = 10;

/* Error of a batch's energy in single precision, relative to it and to 1/threshold. */
static const double ROUNDING = 4 * (double)FLT_EPSILON;

static double min_damping(const tm_world *world, const tm_ranges *where) {
    const tm_tissue *tissue = world->tissue;
    double least = HUGE_VAL;
    for (int32_t i = 0; world->damped && i < where->count; i++)
        for (int32_t v = where->end[2 * i]; v < where->end[2 * i + 1]; v++)
            if (tissue->mass_kg[v] > 0) least = fmin(least, tissue->damping_kg_s[v] / tissue->mass_kg[v]);
    return least < HUGE_VAL ? least : 0;
}

/* --- passes over the vertices, divided among threads --- */

/* Vertices are summed in blocks from the first on, and the blocks' sums in ascending order: the same bits for any
 * number of threads, and for a body alone. */
enum { BLOCK = 256 };

static int32_t count_blocks(const tm_ranges *r) { return (tm_ranges_length(r) + BLOCK - 1) / BLOCK; }

/* Goes over the vertices [begin, end) of a block. */
typedef void block_work(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end);

typedef struct pass {
    tm_conserving *c;
    tm_world *world;
    block_work *work;
} pass;

static void run_part(void *context, int32_t part) {
    const pass *p = context;
    const tm_ranges *where = p->c->where;
    const int32_t count = count_blocks(where), parts = p->world->partition_count,
                  last = tm_tet_batches_before(count, part + 1, parts);
    for (int32_t b = tm_tet_batches_before(count, part, parts); b < last; b++) {
        const int32_t from = tm_ranges_first(where) + BLOCK * b;
        for (int32_t i = 0, begin, end; tm_ranges_next(where, &i, from, from + BLOCK, &begin, &end);)
            p->work(p->c, p->world, b, begin, end);
    }
}

static void run_pass(tm_conserving *c, tm_world *world, block_work *work) {
    pass p = {c, world, work};
    tm_partitions_run(world, run_part, &p);
}

static void add(double *TM_RESTRICT to, const double *TM_RESTRICT from, int32_t begin, int32_t end) {
    for (int64_t i = 3 * (int64_t)begin; i < 3 * (int64_t)end; i++) to[i] += from[i];
}

static void copy(double *to, const double *from, int32_t begin, int32_t end) {
    memcpy(to + 3 * (int64_t)begin, from + 3 * (int64_t)begin, sizeof *to * 3 * (size_t)(end - begin));
}

static void add_all(const tm_conserving *c, double *to, const double *from) {
    for (int32_t k = 0; k < c->where->count; k++) add(to, from, c->where->end[2 * k], c->where->end[2 * k + 1]);
}

static void copy_all(const tm_conserving *c, double *to, const double *from) {
    for (int32_t k = 0; k < c->where->count; k++) copy(to, from, c->where->end[2 * k], c->where->end[2 * k + 1]);
}

/* Computes the energy that the last step generated, without W. Sets push_N to the change of the force, and computes its
 * work in the next step at share 1. */
static void go_over(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end) {
    const tm_state *s = &world->state;
    const double *TM_RESTRICT u = s->u_m, *TM_RESTRICT u_prev = s->u_prev_m, *TM_RESTRICT force = s->force_N,
                              *TM_RESTRICT all = c->all_N, *TM_RESTRICT all_before = c->all_before_N,
                              *TM_RESTRICT now = c->now_N, *TM_RESTRICT now_before = c->now_before_N;
    double *TM_RESTRICT push = c->push_N, generated_J[3] = {0}, p_J[3] = {0}, q_J[3] = {0}; /* by axis */
    for (int32_t v = begin; v < end; v++) {
        const double mobility = world->mobility_s2_kg[v], carry = world->damped ? world->inertia[v] : 1;
        for (int k = 0; k < 3; k++) {
            const int64_t i = 3 * (int64_t)v + k;
            const double came = u[i] - u_prev[i], change = all[i] - all_before[i];
            push[i] = change;
            generated_J[k] += 0.5 * (now[i] + now_before[i]) * came;
            if (!(mobility > 0)) continue;
            p_J[k] += change * (0.5 * (came + carry * came + mobility * force[i]));
            q_J[k] += 0.5 * mobility * change * change;
        }
    }
    tm_conserve_sums *sum = c->sum + block;
    for (int k = 0; k < 3; k++) sum->generated_J += generated_J[k], sum->p_J += p_J[k], sum->q_J += q_J[k];
}

static void begin_block(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end) {
    const int64_t first = 3 * (int64_t)begin;
    c->sum[block].differs |=
        memcmp(c->seen_m + first, world->state.u_prev_m + first, sizeof(double) * 3 * (size_t)(end - begin)) != 0;
    go_over(c, world, block, begin, end);
}

/* Adds the correction to the tensors' force, which is the world's until then. */
static void add_to_tensors(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end) {
    add(world->state.force_N, c->now_N, begin, end);
    copy(c->all_N, world->state.force_N, begin, end);
    begin_block(c, world, block, begin, end);
}

/* The same where the world's force has other parts, and the tensors' is in all_N. */
static void add_to_others(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end) {
    add(c->all_N, c->now_N, begin, end);
    add(world->state.force_N, c->now_N, begin, end);
    begin_block(c, world, block, begin, end);
}

static void end_block(tm_conserving *c, tm_world *world, int32_t block, int32_t begin, int32_t end) {
    double *TM_RESTRICT force = world->state.force_N, *TM_RESTRICT push = c->push_N;
    (void)block;
    const double share = c->share;
    for (int64_t i = 3 * (int64_t)begin; share != 0 && i < 3 * (int64_t)end; i++) {
        push[i] *= share;
        force[i] += push[i];
    }
    copy(c->seen_m, world->state.u_m, begin, end);
}

/* Returns the sums, and sets those of the blocks to zero. */
static tm_conserve_sums take_sums(tm_conserving *c) {
    tm_conserve_sums all = {0};
    for (int32_t b = 0; b < count_blocks(c->where); b++) {
        const tm_conserve_sums *one = c->sum + b;
        all.generated_J += one->generated_J, all.p_J += one->p_J, all.q_J += one->q_J;
        all.differs |= one->differs;
        c->sum[b] = (tm_conserve_sums){0};
    }
    return all;
}

/* --- the law --- */

void tm_conserve_clear(tm_conserving *c, int32_t part, int32_t parts) {
    const int32_t first = tm_ranges_first(c->where), n = tm_ranges_length(c->where);
    const int64_t begin = 3 * (int64_t)(first + tm_tet_batches_before(n, part, parts)),
                  end = 3 * (int64_t)(first + tm_tet_batches_before(n, part + 1, parts));
    memset(c->now_N + begin, 0, sizeof(double) * (size_t)(end - begin));
}

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
    c->sum = TM_ALLOC(pool, tm_conserve_sums, count_blocks(c->where));
    return !pool->failed;
}

/* Chooses the share that removes generated_J; the rest stays there and fades as fast as motion is damped. */
static double choose_share(tm_conserving *c, double dt_s, const tm_conserve_sums *sum) {
    double share = 0;
    bool all = false;
    if (sum->p_J < 0 && fabs(c->generated_J) >= c->rounding_J) {
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

static void swap(double **a, double **b) {
    double *const of_a = *a;
    *a = *b, *b = of_a;
}

/* Adds the removing force after `first`, a pass that ends with begin_block. `find_before` computes the values at u_prev
 * if those stored are of another state. */
static void take_back(tm_conserving *c, tm_world *world, double energy_J, block_work *first,
                      void (*find_before)(tm_conserving *, tm_world *)) {
    const tm_state *s = &world->state;
    c->share = 0;
    run_pass(c, world, first);
    tm_conserve_sums sum = take_sums(c);
    if (s->time_s == c->last_s) return; /* no step: tissue settles */
    if (!c->valid || sum.differs) {
        find_before(c, world);
        run_pass(c, world, go_over);
        sum = take_sums(c);
    }
    c->generated_J += energy_J - c->energy_J + sum.generated_J;
    c->share = choose_share(c, s->dt_s, &sum);
    run_pass(c, world, end_block);
    c->valid = true, c->last_s = s->time_s, c->energy_J = energy_J;
    swap(&c->now_N, &c->now_before_N);
    swap(&c->all_N, &c->all_before_N);
}

/* --- correction in addition to the tensors --- */

static double sum_of(const double *partition, int32_t count) {
    double sum = 0;
    for (int32_t n = 0; n < count; n++) sum += partition[n];
    return sum;
}

/* Returns a bound of the rounding of the energies in single precision, whose errors are independent. Energy below it is
 * not removed: that would keep tissue moving that comes to rest. */
static double rounding_of(const tm_conserving *c) {
    const tm_rotation *r = c->rotation;
    double square = 0;
    if (!r->batches.single) return 0;
    for (int32_t n = 0; n < r->list_count; n++) square += c->batch_J[n] * c->batch_J[n];
    return ROUNDING / r->threshold * sqrt(square);
}

static void find_correction(tm_conserving *c, tm_world *world) {
    tm_rotation *r = c->rotation;
    const double *u = world->state.u_prev_m;
    tm_ranges_clear(c->where, c->now_before_N);
    r->kernel(&r->batches, r->elastic, r->elastic_count, u, c->now_before_N, c->batch_J);
    c->energy_J = sum_of(c->batch_J, r->elastic_count);
    linear_force(c, world, u, c->all_before_N);
    add_all(c, c->all_before_N, c->now_before_N);
}

/* Returns whether force_N is the tensors' alone when the stage begins: "force", which sets it, is directly before. */
static bool follows_force(const tm_conserving *c, const tm_world *world) {
    int32_t own = 0;
    while (own < world->stage_count && world->entry[own].stage.self != (void *)c->rotation) own++;
    return own > 0 && own < world->stage_count && !strcmp(world->entry[own - 1].stage.name, "force");
}

void tm_conserve(tm_conserving *c, tm_world *world) {
    if (world->evaluating) {
        add_all(c, world->state.force_N, c->now_N);
        return;
    }
    const double energy_J = sum_of(c->batch_J, c->rotation->list_count);
    c->rounding_J = rounding_of(c);
    const bool follows = follows_force(c, world);
    if (!follows) linear_force(c, world, world->state.u_m, c->all_N);
    take_back(c, world, energy_J, follows ? add_to_tensors : add_to_others, find_correction);
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
    copy_all(c, c->all_before_N, c->now_before_N);
    c->energy_J = whole_energy(c, own.u_prev_m);
}

void tm_conserve_whole(tm_conserving *c, tm_world *world) {
    double *force = world->state.force_N;
    if (!c->on || world->evaluating) {
        tm_relaxing_force(c->rotation->whole);
        return;
    }
    copy_all(c, c->push_N, force);
    tm_ranges_clear(c->where, force);
    tm_relaxing_force(c->rotation->whole);
    copy_all(c, c->now_N, force);
    copy_all(c, c->all_N, force);
    add_all(c, force, c->push_N);
    take_back(c, world, whole_energy(c, world->state.u_m), begin_block, find_whole);
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
