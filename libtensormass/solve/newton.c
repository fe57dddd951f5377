/* Newton's method with the full matrix, by finite differences, and the derivative of its solution. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

/* Secant steps for ticks that differ little from the previous one: the known matrix, corrected by recent responses of
 * the residual (Anderson's method). They take one evaluation per step; Newton's take one per Krylov vector. The
 * corrections serve the next tick too. */

static bool knows_all(const tms_contact_solver *l) {
    for (int32_t i = 0; i < l->now.count; i++)
        for (int k = 0; k < 3 && !l->tool[l->now.row[i].instrument].prescribed; k++)
            if (l->active_of[l->slot_of[l->now.row[i].vertex[k]]] < 0) return false;
    return true;
}

/* Converts from slot order to the order of active unknowns. */
static void pick(const tms_contact_solver *l, const double *by_slot, double *by_act) {
    for (int32_t j = 0; j < l->active_count; j++) memcpy(by_act + 3 * j, by_slot + 3 * l->active[j], 24);
}

/* Removes from b its part in the span of the recent changes of r; adds the matching changes of f to f_part. Newest
 * first; linearly dependent changes are skipped. */
static void use_pairs(tms_contact_solver *l, double *b, double *f_part) {
    const int32_t m = 3 * l->active_count;
    double *q[TMS_PAIRS], *f[TMS_PAIRS];
    int32_t n = 0;
    memset(f_part, 0, 8 * (size_t)m);
    for (int32_t k = 1; k <= l->pair_count; k++) {
        const int32_t at = (l->pair_next + TMS_PAIRS - k) % TMS_PAIRS;
        double *r = l->krylov[n], *df = l->preconditioned[n], size = 0, left = 0;
        pick(l, l->pair_r[at], r);
        pick(l, l->pair_f[at], df);
        for (int32_t j = 0; j < m; j++) r[j] *= tms_contact_solver_scale(l, j), size += r[j] * r[j];
        for (int32_t i = 0; i < n; i++) {
            double dot = 0;
            for (int32_t j = 0; j < m; j++) dot += r[j] * q[i][j];
            for (int32_t j = 0; j < m; j++) r[j] -= dot * q[i][j], df[j] -= dot * f[i][j];
        }
        for (int32_t j = 0; j < m; j++) left += r[j] * r[j];
        if (!(left > 1e-8 * size)) continue;
        const double unit = 1 / sqrt(left);
        for (int32_t j = 0; j < m; j++) r[j] *= unit, df[j] *= unit;
        q[n] = r, f[n] = df;
        n++;
    }
    for (int32_t i = 0; i < n; i++) {
        double dot = 0;
        for (int32_t j = 0; j < m; j++) dot += b[j] * tms_contact_solver_scale(l, j) * q[i][j];
        for (int32_t j = 0; j < m; j++)
            b[j] -= dot * q[i][j] / tms_contact_solver_scale(l, j), f_part[j] += dot * f[i][j];
    }
}

static void remember(tms_contact_solver *l, const double *f_before, const double *r_before) {
    double *df = l->pair_f[l->pair_next], *dr = l->pair_r[l->pair_next];
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * l->used[i] + c;
            df[d] = l->f[d] - f_before[d];
            dr[d] = l->r[d] - r_before[d];
        }
    l->pair_next = (l->pair_next + 1) % TMS_PAIRS;
    if (l->pair_count < TMS_PAIRS) l->pair_count++;
}

/* Runs secant steps until they converge or stall; returns their number. */
static int32_t tms_contact_solver_secant(tms_contact_solver *l, double *merit) {
    double *b = l->step, *f_part = l->krylov[TMS_KRYLOV], *f_before = l->f_kept, *r_before = l->f_spare;
    bool factored = false;
    int32_t steps = 0;
    while (!l->converged && steps < TMS_SECANT_STEPS) {
        if (!factored || !knows_all(l)) {
            if (!tms_contact_solver_factor(l, -1)) return steps;
            factored = true;
        }
        const double old = *merit;
        memcpy(f_before, l->f, 24 * (size_t)l->capacity);
        memcpy(r_before, l->r, 24 * (size_t)l->capacity);
        pick(l, l->r, b);
        use_pairs(l, b, f_part);
        tms_lu_solve(l->lu, l->pivot, 3 * l->active_count, b);
        for (int32_t j = 0; j < 3 * l->active_count; j++) l->f[3 * l->active[j / 3] + j % 3] -= b[j] + f_part[j];
        *merit = tms_contact_solver_evaluate(l);
        remember(l, f_before, r_before);
        steps++;
        l->converged |= l->nearly;
        if (l->converged) break;
        if (*merit > old) { /* diverged: restore, and leave it to Newton */
            memcpy(l->f, f_before, 24 * (size_t)l->capacity);
            *merit = tms_contact_solver_evaluate(l);
            break;
        }
        if (*merit > 0.8 * old) break; /* stalled */
    }
    return steps;
}

static const double BESIDE = 1e-5; /* radii: perturbation of the shape in linear steps */
/* Relative to the residual: tolerance of linear solves. */
static const double CLOSELY = 1e-3, ROUGHLY = 0.1;
static const double STRIDE = 0.3; /* radii: maximum surface motion of one step; farther rows would be different ones */

/* Saves the shape, to perturb it and restore it. */
static void keep_shape(tms_contact_solver *l) {
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) l->f_kept[3 * l->used[i] + c] = l->u_m[3 * (int64_t)l->vertex[l->used[i]] + c];
}
static void set_shape(tms_contact_solver *l, double h) {
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * l->used[i] + c;
            l->u_m[3 * (int64_t)l->vertex[l->used[i]] + c] = l->f_kept[d] + h * l->du[d];
        }
}

/* du := C df over the slots; df by active unknown. Returns the largest in use. */
static double response(tms_contact_solver *l, const double *df) {
    double most = 0;
    tms_contact_solver_response(l, l->active, l->active_count, df, false, l->du);
    for (int32_t i = 0; i < 3 * l->used_count; i++) most = fmax(most, fabs(l->du[3 * l->used[i / 3] + i % 3]));
    return most;
}

/* Direction of a finite difference: the shape by du, and a tool's tip by one unit vector (tool < 0: none). Gives the
 * change of the rows' forces by active unknown, and of the tip's force, per unit. Needs one perturbed evaluation, or
 * two for a derivative. */
typedef struct direction {
    int32_t tool;
    int axis;
    bool both_sides;
    double dF[3];
} direction;

static void look_along(tms_contact_solver *l, direction *to, double h, double *change) {
    const tms_tool kept = to->tool >= 0 ? l->tool[to->tool] : l->tool[0];
    memset(to->dF, 0, sizeof to->dF);
    for (int32_t j = 0; j < 3 * l->active_count; j++) change[j] = 0;
    for (int side = 0; side < 2; side++) {
        const tms_contact_eval *look = &l->now;
        const double s = side == 0 ? 1 : to->both_sides ? -1 : 0;
        if (s != 0) {
            if (to->tool >= 0) {
                tms_tool *tool = &l->tool[to->tool];
                tool->pose.tip_m[to->axis] = kept.pose.tip_m[to->axis] + s * h;
                tool->capsule = tm_tool_capsule(&tool->def, &tool->pose, to->tool);
            }
            set_shape(l, s * h);
            tms_contact_solver_evaluate_shape(l, &l->probe, 0);
            look = &l->probe;
        }
        const double weight = (side == 0 ? 1 : -1) / (to->both_sides ? 2 * h : h);
        for (int32_t j = 0; j < 3 * l->active_count; j++) change[j] += weight * look->fc[3 * l->active[j / 3] + j % 3];
        for (int c = 0; c < 3 && to->tool >= 0; c++) to->dF[c] += weight * look->force_N[to->tool][c];
    }
    if (to->tool >= 0) l->tool[to->tool] = kept;
}

/* Returns the radius of the thinnest tool in contact, the unit of lengths. */
static double thinnest(const tms_contact_solver *l) {
    double least = INFINITY;
    for (int32_t t = 0; t < l->tool_count; t++)
        if (l->tool[t].near) least = fmin(least, l->tool[t].def.radius_m);
    return least < INFINITY ? least : l->tool[0].def.radius_m;
}

/* out := A df, A = dr/df. With a tool in `to`: the change of r when df is the change of f and the tip moves by one
 * unit. */
static void apply(tms_contact_solver *l, direction *to, const double *df, double *out) {
    const double most = fmax(response(l, df), to->tool >= 0 ? 1 : 0),
                 radius = to->tool >= 0 ? l->tool[to->tool].def.radius_m : thinnest(l);
    if (most > 0 && l->tool_count)
        look_along(l, to, BESIDE * radius / most, out);
    else
        memset(out, 0, 24 * (size_t)l->active_count);
    for (int32_t j = 0; j < 3 * l->active_count; j++) {
        const int32_t s = l->active[j / 3];
        out[j] = tms_is_pinned(l, s, j % 3) ? l->du[3 * s + j % 3] + tms_pin_of(l, s)->compliance_m_N * (df[j] - out[j])
                                            : df[j] - out[j];
        for (int k = 0; k < 3 && l->pin_of[s] >= 0; k++)
            out[j] -= tms_pin_rotates(tms_pin_of(l, s), j % 3, k) * l->du[3 * s + k];
    }
}

static double inner(const tms_contact_solver *l, const double *a, const double *b) {
    double sum = 0;
    for (int32_t j = 0; j < 3 * l->active_count; j++)
        sum += a[j] * b[j] * tms_contact_solver_scale(l, j) * tms_contact_solver_scale(l, j);
    return sum;
}

/* x := A^-1 b by GMRES, right-preconditioned by the factorised known part. Stops at `tolerance` of |b|. Requires
 * keep_shape. */
static void krylov_solve(tms_contact_solver *l, const double *b, double tolerance, bool both_sides, double *x) {
    const int32_t m = 3 * l->active_count;
    double H[TMS_KRYLOV + 1][TMS_KRYLOV], cosine[TMS_KRYLOV], sine[TMS_KRYLOV], g[TMS_KRYLOV + 1], y[TMS_KRYLOV];
    direction to = {.tool = -1, .both_sides = both_sides};
    const double norm = sqrt(inner(l, b, b));
    int32_t k = 0;
    g[0] = norm;
    for (int32_t j = 0; j < m && norm > 0; j++) l->krylov[0][j] = b[j] / norm;
    while (norm > 0 && k < TMS_KRYLOV && fabs(g[k]) > tolerance * norm) {
        double *next = l->krylov[k + 1];
        memcpy(l->preconditioned[k], l->krylov[k], 8 * (size_t)m);
        tms_lu_solve(l->lu, l->pivot, m, l->preconditioned[k]);
        apply(l, &to, l->preconditioned[k], next);
        for (int32_t i = 0; i <= k; i++) {
            H[i][k] = inner(l, next, l->krylov[i]);
            for (int32_t j = 0; j < m; j++) next[j] -= H[i][k] * l->krylov[i][j];
        }
        H[k + 1][k] = sqrt(inner(l, next, next));
        for (int32_t j = 0; j < m && H[k + 1][k] > 0; j++) next[j] /= H[k + 1][k];
        for (int32_t i = 0; i < k; i++) {
            const double t = cosine[i] * H[i][k] + sine[i] * H[i + 1][k];
            H[i + 1][k] = cosine[i] * H[i + 1][k] - sine[i] * H[i][k];
            H[i][k] = t;
        }
        const double length = hypot(H[k][k], H[k + 1][k]);
        if (!(length > 0)) break;
        cosine[k] = H[k][k] / length;
        sine[k] = H[k + 1][k] / length;
        H[k][k] = length;
        g[k + 1] = -sine[k] * g[k];
        g[k] *= cosine[k];
        k++;
    }
    memset(x, 0, 8 * (size_t)m);
    for (int32_t i = k - 1; i >= 0; i--) {
        y[i] = g[i];
        for (int32_t j = i + 1; j < k; j++) y[i] -= H[i][j] * y[j];
        y[i] /= H[i][i];
        for (int32_t j = 0; j < m; j++) x[j] += y[i] * l->preconditioned[i][j];
    }
}

/* --- Newton --- */

/* Takes one step, halved on overshoot; returns false if no part of it helps. */
static bool descend(tms_contact_solver *l, double tolerance, double *merit) {
    const double old = *merit;
    const int32_t m = 3 * l->active_count;
    double *b = l->krylov[TMS_KRYLOV];
    for (int32_t j = 0; j < m; j++) b[j] = l->r[3 * l->active[j / 3] + j % 3];
    keep_shape(l);
    krylov_solve(l, b, tolerance, false, l->step);
    for (int32_t j = 0; j < m; j++) l->f_kept[3 * l->active[j / 3] + j % 3] = l->f[3 * l->active[j / 3] + j % 3];
    double s = l->tool_count && l->now.count ? fmin(1, STRIDE * thinnest(l) / (response(l, l->step) + 1e-300)) : 1;
    for (int i = 0; i <= TMS_HALVINGS; i++, s *= 0.5) {
        for (int32_t j = 0; j < m; j++) {
            const int32_t d = 3 * l->active[j / 3] + j % 3;
            l->f[d] = l->f_kept[d] - s * l->step[j];
        }
        *merit = tms_contact_solver_evaluate(l);
        if (l->converged || *merit < (1 - 0.1 * s) * old) return true;
    }
    return false;
}

int32_t tms_contact_solver_solve(tms_contact_solver *l) {
    double merit = tms_contact_solver_evaluate(l);
    int32_t steps = l->converged ? 0 : tms_contact_solver_secant(l, &merit);
    while (!l->converged && steps < TMS_NEWTON_STEPS) { /* stalled: use the full matrix */
        steps++;
        if (!tms_contact_solver_factor(l, -1) || !descend(l, l->inexact ? ROUGHLY : CLOSELY, &merit)) break;
        l->converged |= l->inexact && l->nearly;
    }
    l->previous_count = l->now.count;
    memcpy(l->previous, l->now.row, (size_t)l->now.count * sizeof *l->now.row);
    return steps;
}

/* --- derivative --- */

/* Computes the stiffness of a tool with a grasp: the tool is moved, since its vertices move with it. */
static void holding_stiffness(tms_contact_solver *l, int32_t t, double K[9]) {
    const tm_tool_pose pose = l->tool[t].pose;
    const double h = 1e-3 * l->tool[t].def.radius_m;
    double unused[3];
    memcpy(l->f_saved, l->f, 24 * (size_t)l->capacity);
    for (int i = 0; i < 7; i++) { /* the last one restores the state */
        const double side = i == 6 ? 0 : i % 2 ? -1 : 1;
        tm_tool_pose at = pose;
        at.tip_m[i / 2 % 3] += side * h;
        tms_contact_solver_move(l, t, &at);
        tms_contact_solver_follow_jaws(l);
        if (i == 6)
            memcpy(l->f, l->f_saved, 24 * (size_t)l->capacity), tms_contact_solver_evaluate(l);
        else
            tms_contact_solver_solve(l);
        double force[3];
        tms_contact_solver_force(l, t, force, unused);
        for (int c = 0; c < 3 && i < 6; c++) K[3 * c + i / 2] += side * force[c] / (2 * h);
    }
}

void tms_contact_solver_stiffness(tms_contact_solver *l, int32_t t, double K[9]) {
    memset(K, 0, 9 * sizeof *K);
    if (tms_contact_solver_is_grasping(l, t)) {
        holding_stiffness(l, t, K);
        return;
    }
    bool any = false;
    for (int32_t i = 0; i < l->now.count; i++) any |= l->now.row[i].instrument == t;
    if (!any || !tms_contact_solver_factor(l, -1)) return;
    double *b = l->krylov[TMS_KRYLOV];
    keep_shape(l);
    for (int axis = 0; axis < 3; axis++) {
        /* r stays zero: A df = -(change of r by the tip alone); then the force along both */
        direction to = {.tool = t, .axis = axis, .both_sides = true};
        memset(l->step, 0, 24 * (size_t)l->active_count);
        apply(l, &to, l->step, b);
        for (int32_t j = 0; j < 3 * l->active_count; j++) b[j] = -b[j];
        krylov_solve(l, b, 1e-8, true, l->step);
        apply(l, &to, l->step, b);
        for (int c = 0; c < 3; c++) K[3 * c + axis] = to.dF[c];
    }
    set_shape(l, 0);
}
