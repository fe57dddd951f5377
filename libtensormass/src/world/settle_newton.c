/* Equilibrium of nonlinear tissue: Newton's method on the complete nonlinear problem, with conjugate gradients inside.
 *
 * Supports and loads are applied in load steps: supports along their path (settle_newton.h), loads as f(s) = f - (1 -
 * s) r0. r0 is the residual of the initial state, which is thus at equilibrium for s = 0. A load step that does not
 * converge is rolled back and halved. So is one that inverts tetrahedra, or stores more energy than the work of its
 * forces. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "libtensormass/numeric/random.h"
#include "world/pressure.h"
#include "world/settle_newton.h"
#include "world/vertex_blocks.h"

/* Limits: Newton steps of a load step, those without progress, halvings of one; load steps attempted, doubtful ones
 * rolled back; conjugate gradients of a Newton step per component. */
enum { NEWTON_STEPS = 100, IDLE_STEPS = 12, HALVINGS = 30, TRIES = 120, DOUBTS = 24, GRADIENTS = 4 };
static const double TURN_MAX = 0.55;        /* rad, rotation of supports in the first load step; twice that later */
static const double FALLS = 1e-4;           /* of the stored energy: a large decrease */
static const double MIN_INCREMENT = 1e-3;   /* of the path */
static const double SHORT_INCREMENT = 0.01; /* of the path: a doubtful step this short is accepted */
static const double WORK_ERROR = 0.25; /* of the trapezoidal rule, as a share of the stored energy of a load step */
static const double JUMBLED = 0.1;     /* of the tetrahedra inverted: no shape to start from */
static const double ROUNDING = 1e-6;   /* residuals below this that stop falling are rounding */

typedef struct newton {
    tm_pool pool;
    const tm_nonlinear *law;
    const tm_tissue *tissue;
    const tm_world *world;
    bool pressed; /* pressures follow the surface */
    double s;     /* position on the path */
    const tm_newton_rest *rest_args;
    const tm_settle_def *def;
    int32_t n;
    tm_tangent tangent;
    double *load, *force, *corotated;                /* [n] external at s; internal; its correction */
    double *residual, *step, *image, *scaled, *move; /* [n] */
    double *last, *last_force, *lack, *inverse; /* [n] u and force at the last s; r0; [3n] inverse vertex tensors */
    tm_settle_path path;
    tm_force_scale scale;
    int64_t steps;
    int32_t load_steps;
    bool indefinite; /* the last tangent was not positive where it was solved */
    bool fell;       /* the energy fell by a large amount in the last Newton step */
    double relative;
} newton;

static double largest(const double *a, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++) most = fmax(most, fabs(a[i]));
    return most;
}

/* Sets the load at s. Pressures are those at u: constant until the next call, so a Newton step descends an energy. */
static void set_load(newton *w, double s, const double *u) {
    w->s = s;
    for (int32_t i = 0; i < w->n; i++) w->load[i] = w->rest_args->external_N[i] - (1 - s) * w->lack[i];
    if (w->pressed) tm_pressure_add(w->world, u, w->load);
}

/* Computes the residual at u, and its size relative to the forces. Returns its norm. */
static double look(newton *w, const double *u) {
    tm_tissue_force(w->tissue, u, w->force);
    w->law->force(w->law->self, u, w->corotated);
    for (int32_t i = 0; i < w->n; i++) w->force[i] += w->corotated[i];
    for (int32_t i = 0; i < w->n; i++) w->residual[i] = w->rest_args->fixed[i] ? 0 : w->load[i] + w->force[i];
    const double most = largest(w->residual, w->n);
    const double beside = fmax(largest(w->rest_args->external_N, w->n), largest(w->force, w->n));
    w->relative = most > 0 ? most / fmax(beside, tm_force_scale_at(&w->scale, u, w->n)) : 0;
    return sqrt(tm_product(w->residual, w->residual, w->n));
}

static double stored(const newton *w, const double *u) {
    return tm_tissue_energy(w->tissue, u) + w->law->energy(w->law->self, u);
}

static double potential(const newton *w, const double *u) { return stored(w, u) - tm_product(w->load, u, w->n); }

/* --- the tangent's system --- */

static void set_tangent(newton *w, const double *u) {
    tm_tangent_begin(w->tissue, &w->tangent);
    w->law->add_tangent(w->law->self, u, 0, w->tissue->mesh->tet_count, &w->tangent);
    if (w->pressed) tm_pressure_add_tangent(w->world, u, &w->tangent);
}

/* move := approximately K^-1 residual on the free components. Where K is not positive, the solution so far, continued
 * along the direction of negative curvature. Overwrites the residual. */
static tm_status solve(newton *w, double accuracy, tm_error *error) {
    const int32_t n = w->n;
    tm_blocks_invert(w->tangent.graph.vertex_tensor, w->rest_args->fixed, w->n, w->inverse);
    w->indefinite = false;
    tm_blocks_apply(w->inverse, w->residual, w->n, w->step);
    double rz = tm_product(w->residual, w->step, n);
    const double enough = accuracy * accuracy * rz;
    for (int32_t i = 0; i < n; i++)
        if (!w->rest_args->fixed[i]) w->move[i] = 0;
    int64_t left = 1000 + (int64_t)GRADIENTS * n;
    for (bool first = true; rz > enough && left-- > 0; first = false) {
        tm_force_pass(w->tangent.force, &w->tangent.graph, w->step, w->image);
        for (int32_t i = 0; i < n; i++)
            if (w->rest_args->fixed[i]) w->image[i] = 0;
        const double curvature = -tm_product(w->step, w->image, n);
        if (!(curvature > 0)) {
            const double length = first ? 1 : curvature < 0 ? fmin(1, rz / -curvature) : 1;
            for (int32_t i = 0; i < n; i++) w->move[i] += length * w->step[i];
            w->indefinite = true;
            return TM_OK;
        }
        const double length = rz / curvature;
        for (int32_t i = 0; i < n; i++) {
            w->move[i] += length * w->step[i];
            w->residual[i] += length * w->image[i];
        }
        tm_blocks_apply(w->inverse, w->residual, w->n, w->scaled);
        const double next = tm_product(w->residual, w->scaled, n), carry = next / rz;
        for (int32_t i = 0; i < n; i++) w->step[i] = w->scaled[i] + carry * w->step[i];
        rz = next;
        const bool told = w->def->progress && w->steps % 128 == 0;
        if (++w->steps >= w->def->max_steps ||
            (told && !w->def->progress(w->def->user, w->steps, fmax(w->relative, w->def->tolerance))))
            return tm_fail(
                error, TM_ERR_CONVERGENCE, -1,
                "the residual is %g after %lld steps, above the tolerance of %g; allow more steps or a larger "
                "tolerance, or add supports",
                w->relative, (long long)w->steps, w->def->tolerance);
    }
    return TM_OK;
}

/* --- one load step --- */

/* Returns the rounding error of energies at u: stored energy is a difference of terms of this size. */
static double rounding_J(const newton *w, const double *u) {
    const double most_m = largest(u, w->n);
    return 1e-12 * (w->scale.stiffness_N_m * most_m * most_m + fabs(tm_product(w->load, u, w->n)));
}

static void step_to(const newton *w, double *u, double length) {
    for (int32_t i = 0; i < w->n; i++) u[i] = w->scaled[i] + (w->rest_args->fixed[i] ? 0 : length * w->move[i]);
}

/* u += the increment, halved until the energy falls, or the residual falls while the energy does not rise. If the
 * tangent gave no length, it is doubled while the energy falls. Returns false if neither falls. */
static bool descend(newton *w, double *u) {
    const double before = potential(w, u), lack = look(w, u), slope = tm_product(w->residual, w->move, w->n);
    const double noise = rounding_J(w, u) + 1e-9 * fabs(before);
    double length = 1, energy = before;
    bool falls = false;
    memcpy(w->scaled, u, sizeof(double) * (size_t)w->n);
    for (int k = 0; k < HALVINGS && !falls; k++) {
        length = k ? 0.5 * length : 1;
        step_to(w, u, length);
        const double now = look(w, u);
        energy = potential(w, u);
        falls = energy < before - 1e-4 * length * fabs(slope) ||
                (now < lack * (1 - 1e-4 * length) && energy <= before + noise);
    }
    for (int k = 0; k < HALVINGS && falls && w->indefinite; k++) {
        step_to(w, u, 2 * length);
        const double farther = potential(w, u);
        if (!(farther < energy - noise)) break;
        length *= 2, energy = farther;
    }
    if (!falls || w->indefinite) step_to(w, u, falls ? length : 0);
    look(w, u);
    w->fell = falls && before - energy > FALLS * stored(w, u) + noise;
    return falls;
}

/* Runs Newton steps at one s; sets *rests if they converge. */
static tm_status settle_here(newton *w, double *u, double tolerance, bool *rests, tm_error *error) {
    double best = HUGE_VAL;
    *rests = w->fell = false;
    for (int k = 0, idle = 0; k < NEWTON_STEPS && idle < IDLE_STEPS; k++) {
        if (w->pressed) set_load(w, w->s, u);
        look(w, u);
        *rests = w->relative <= tolerance;
        if (*rests || !isfinite(w->relative)) return TM_OK;
        idle = w->relative < 0.9 * best || w->fell ? 0 : idle + 1;
        best = fmin(best, w->relative);
        set_tangent(w, u);
        const tm_status status = solve(w, fmax(fmin(0.1, w->relative), 1e-6), error);
        if (status) return status;
        if (!descend(w, u)) return TM_OK;
    }
    return TM_OK;
}

/* Predicts u at the next s: the tangent's response to the increments of supports and loads. */
static tm_status predict(newton *w, double *u, double to, tm_error *error) {
    const tm_newton_rest *rest = w->rest_args;
    set_load(w, to, u);
    look(w, u);
    set_tangent(w, u);
    tm_settle_path_at(&w->path, to, u);
    for (int32_t i = 0; i < w->n; i++) w->move[i] = rest->fixed[i] ? u[i] - w->last[i] : 0;
    tm_force_pass(w->tangent.force, &w->tangent.graph, w->move, w->image);
    for (int32_t i = 0; i < w->n; i++)
        if (!rest->fixed[i]) w->residual[i] += w->image[i];
    const tm_status status = solve(w, 1e-3, error);
    for (int32_t i = 0; i < w->n && !status; i++)
        if (!rest->fixed[i]) u[i] += w->move[i];
    return status;
}

/* --- path --- */

/* Returns whether u, at equilibrium, stores no more energy than the work along a straight line from the last
 * equilibrium, by the trapezoidal rule. Another branch of equilibria, which small steps do not reach, stores more. */
static bool is_on_the_way(const newton *w, const double *u, double before, double now) {
    double work = 0;
    for (int32_t i = 0; i < w->n; i++) work -= 0.5 * (w->last_force[i] + w->force[i]) * (u[i] - w->last[i]);
    return now - before <= work + WORK_ERROR * fabs(now - before) + 1e-9 * now + rounding_J(w, u);
}

static tm_status give_up(const newton *w, double at, double tolerance, tm_error *error) {
    if (at == 1 && w->relative < ROUNDING)
        return tm_fail(
            error, TM_ERR_CONVERGENCE, -1,
            "the residual is %.3g, above the tolerance of %.3g, and rounding keeps it from falling further; allow a tolerance of %.1g",
            w->relative, tolerance, 4 * w->relative);
    return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                   "no equilibrium was found beyond %.3g of the supports' motion and loads (residual %.3g, tolerance "
                   "%.3g); move the supports less (several calls, each from the last equilibrium), lower the load, "
                   "refine the mesh where it deforms most, or step the world until it is at rest",
                   at, w->relative, tolerance);
}

typedef struct place {
    double s, stored_J;
    bool upright; /* no tetrahedron is inverted */
    int32_t doubts;
} place;

/* Attempts one load step to `next`; *taken: it is accepted. */
static tm_status load_step(newton *w, double *u, double next, place *at, bool *taken, tm_error *error) {
    const size_t bytes = sizeof(double) * (size_t)w->n;
    memcpy(w->last, u, bytes);
    look(w, u);
    memcpy(w->last_force, w->force, bytes);
    const double tolerance = next < 1 ? fmax(1e-4, w->def->tolerance) : w->def->tolerance;
    tm_status status = predict(w, u, next, error);
    if (!status) status = settle_here(w, u, tolerance, taken, error);
    if (status || !*taken) return status;
    const double now_J = stored(w, u);
    const bool upright = at->upright && tm_tissue_deformation(w->tissue, u).inverted == 0;
    if (at->doubts < DOUBTS && next - at->s > SHORT_INCREMENT &&
        (upright != at->upright || !is_on_the_way(w, u, at->stored_J, now_J))) {
        at->doubts++;
        *taken = false;
        return TM_OK;
    }
    at->s = next, at->stored_J = now_J, at->upright = upright;
    w->load_steps++;
    return TM_OK;
}

static tm_status march(newton *w, double *u, tm_error *error) {
    const double turn = w->path.largest_rotation, largest = turn > 0 ? fmin(1, 2 * TURN_MAX / turn) : 1;
    double increment = turn > 0 ? fmin(1, TURN_MAX / turn) : 1;
    place at = {.stored_J = stored(w, u), .upright = tm_tissue_deformation(w->tissue, u).inverted == 0};
    tm_status status = TM_OK;
    for (int tries = 0; at.s < 1 && !status; tries++) {
        const double next = at.s + 1.01 * increment < 1 ? at.s + increment : 1;
        bool taken;
        status = load_step(w, u, next, &at, &taken, error);
        if (status) break;
        if (taken) {
            increment = fmin(2 * increment, largest);
            continue;
        }
        const bool rounded = next == 1 && w->relative < ROUNDING && w->relative > w->def->tolerance;
        memcpy(u, w->last, sizeof(double) * (size_t)w->n);
        increment *= 0.5;
        if (rounded || increment < MIN_INCREMENT || tries >= TRIES)
            status = give_up(w, rounded ? 1 : at.s, w->def->tolerance, error);
    }
    return status;
}

/* --- equilibria that are no minimum --- */

/* A direction without symmetry. */
static void stir(newton *w) {
    uint32_t random = 1;
    for (int32_t i = 0; i < w->n; i++) {
        num_random32(&random);
        w->residual[i] = w->rest_args->fixed[i] ? 0 : (double)random / 4294967296.0 - 0.5;
    }
}

/* Leaves saddle points. Where the tangent at equilibrium is not positive, continues along the direction of negative
 * curvature to another equilibrium. Accepts it only if its energy is lower. */
static tm_status leave_saddle(newton *w, double *u, tm_error *error) {
    const size_t bytes = sizeof(double) * (size_t)w->n;
    for (int k = 0; k < 3; k++) {
        const double before = potential(w, u), relative = w->relative;
        set_tangent(w, u);
        stir(w);
        tm_status status = solve(w, 1e-4, error);
        if (status || !w->indefinite) return status;
        const double most = largest(w->step, w->n), length = most > 0 ? 1e-3 * w->scale.size_m / most : 0;
        double deepest = before;
        memcpy(w->last, u, bytes);
        memcpy(w->move, w->step, bytes);
        for (int sign = -1; sign <= 1; sign += 2) {
            for (int32_t i = 0; i < w->n; i++) w->scaled[i] = w->last[i] + sign * length * w->move[i];
            const double energy = potential(w, w->scaled);
            if (energy < deepest) deepest = energy, memcpy(u, w->scaled, bytes);
        }
        bool rests = false;
        if (deepest < before) status = settle_here(w, u, w->def->tolerance, &rests, error);
        if (status) return status;
        if (!rests || !(potential(w, u) < before - 1e-9 * fabs(before) - rounding_J(w, u))) {
            memcpy(u, w->last, bytes);
            w->relative = relative;
            return TM_OK;
        }
    }
    return TM_OK;
}

static bool init(newton *w) {
    double **vector[] = {&w->load,   &w->force, &w->corotated, &w->residual,   &w->step, &w->image,
                         &w->scaled, &w->move,  &w->last,      &w->last_force, &w->lack};
    for (size_t i = 0; i < sizeof vector / sizeof vector[0]; i++) *vector[i] = TM_ALLOC(&w->pool, double, w->n);
    w->inverse = TM_ALLOC(&w->pool, double, 3 * (int64_t)w->n);
    return w->law->take_tangent(w->law->self, &w->tangent, &w->pool);
}

static tm_status from_here(newton *w, double *u, tm_error *error) {
    set_load(w, 1, u);
    look(w, u);
    memcpy(w->lack, w->residual, sizeof(double) * (size_t)w->n);
    bool moves = false;
    for (int32_t i = 0; i < w->n; i++) moves = moves || (w->rest_args->fixed[i] && w->rest_args->target_m[i] != u[i]);
    if (!moves && w->relative <= w->def->tolerance) return TM_OK;
    const tm_status status = march(w, u, error);
    return status || w->pressed ? status : leave_saddle(w, u, error);
}

/* The path begins at the undeformed shape if many tetrahedra are inverted: from there Newton's method may end in a
 * folded shape, or nowhere. */
static void leave_jumble(const newton *w, double *u) {
    const int32_t inverted = tm_tissue_deformation(w->tissue, u).inverted;
    if (!w->rest_args->turns_only && inverted > JUMBLED * tm_tissue_alive_count(w->tissue))
        memset(u, 0, sizeof(double) * (size_t)w->n);
}

tm_status tm_settle_newton(const tm_world *world, const tm_newton_rest *rest, const tm_settle_def *def, double *u_m,
                           tm_settle_result *result, tm_error *error) {
    newton w = {.world = world,
                .pressed = tm_world_has_pressure(world),
                .law = world->nonlinear,
                .tissue = world->tissue,
                .rest_args = rest,
                .def = def};
    w.n = 3 * w.tissue->mesh->vertex_count;
    w.scale = tm_force_scale_of(w.tissue);
    leave_jumble(&w, u_m);
    if (!init(&w) || !tm_settle_path_build(&w.path, &w.pool, w.tissue, rest->fixed, rest->target_m, u_m)) {
        tm_pool_release(&w.pool);
        return tm_fail_memory(error, "settling");
    }
    const bool nothing = rest->turns_only && !w.path.rotation_of && w.path.largest_rotation == 0;
    const tm_status status = nothing ? TM_OK : from_here(&w, u_m, error);
    *result = (tm_settle_result){.steps = w.steps, .residual = w.relative, .load_steps = w.load_steps};
    tm_pool_release(&w.pool);
    return status;
}
