/* The online contact solver: the path of the tools, and its solution. Slots are in vertex_slots.c, jaws in
 * online_grasp.c, the matrix in newton_matrix.c, Newton's method and the secant steps in newton.c. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

/* Fallback without a solution by Newton's method: normals and shares that jump with the shape (a thin tool between the
 * lips of a cut) may leave none. Rows detected in the previous shape, frozen, always have one. They are swept as the
 * core does (contact_solve.c) until no row changes: as accurate as a dynamic model's contact. */

enum { SWEEPS = 200 };
static const double MARGIN = 0.1;   /* radii: rows within it may be touched when others yield */
static const double SETTLED = 1e-4; /* radii: maximum motion by a row's last change */

/* The row's forces on the slots, per newton: G. */
typedef struct lever {
    int32_t component[9];
    double G[9];
} lever;

static lever lever_of(const tms_contact_solver *l, const tm_contact_row *row) {
    lever of;
    for (int a = 0; a < 9; a++) {
        of.component[a] = 3 * l->slot_of[row->vertex[a / 3]] + a % 3;
        of.G[a] = row->weight[a / 3] * row->normal[a % 3];
    }
    return of;
}

/* Returns the gap's change by the displacements du, and per newton of the row itself. */
static double along(const lever *of, const double *du) {
    double sum = 0;
    for (int a = 0; a < 9; a++) sum += of->G[a] * du[of->component[a]];
    return sum;
}
static double diagonal(const tms_contact_solver *l, const lever *of) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double sum = 0;
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++) sum += of->G[a] * l->block[of->component[a] * c3 + of->component[b]] * of->G[b];
    return sum;
}

static void push(const tms_contact_solver *l, const lever *of, double lambda_N, double *f, double *du) {
    for (int a = 0; a < 9; a++) {
        if (of->G[a] == 0) continue;
        f[of->component[a]] += lambda_N * of->G[a];
        tms_contact_solver_spread(l, of->component[a], lambda_N * of->G[a], du);
    }
}

/* Relaxes one row; returns its previous distance from its law, in radii. */
static double relax(tms_contact_solver *l, tm_contact_row *row, double *du) {
    const lever of = lever_of(l, row);
    const double radius = l->tool[row->instrument].def.radius_m,
                 compliance = l->def.contact_compliance_m_N / row->share;
    const double own = diagonal(l, &of), free_gap = row->gap_m + along(&of, du) - own * row->lambda_N,
                 change = tm_contact_compliance_reaction(compliance, radius, free_gap, own, l->def.force_cap_N) -
                          row->lambda_N;
    push(l, &of, change, l->f, du);
    row->lambda_N += change;
    return fabs(change) * (own + compliance) / radius;
}

void tms_contact_solver_freeze(tms_contact_solver *l, const double *f_before) {
    double *du = l->f_kept; /* from the shape in which the rows are detected */
    memcpy(l->f, f_before, 24 * (size_t)l->capacity);
    tms_contact_solver_shape(l);
    tms_contact_solver_evaluate_shape(l, &l->now, MARGIN);
    tms_contact_solver_response(l, l->used, l->used_count, l->f, true, du);
    for (int32_t i = 0; i < 3 * l->high; i++) du[i] = -du[i];
    memset(l->f, 0, 24 * (size_t)l->capacity);
    for (int32_t i = 0; i < l->now.count; i++) {
        const lever of = lever_of(l, &l->now.row[i]);
        push(l, &of, l->now.row[i].lambda_N, l->f, du);
    }
    for (int32_t sweep = 0; sweep < SWEEPS && !l->converged; sweep++) { /* in both directions: no row is always last */
        double most = 0;
        for (int32_t i = 0; i < l->now.count; i++)
            most = fmax(most, relax(l, &l->now.row[sweep % 2 ? l->now.count - 1 - i : i], du));
        l->converged = most <= SETTLED;
    }
    tms_contact_solver_sum(l, &l->now);
    tms_contact_solver_shape(l);
}

/* Returns the number of increments of the path. */
static double path_pieces(const tms_contact_solver *l, const tm_tool_pose *pose) {
    double most = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        const tm_capsule to = tm_tool_capsule(&l->tool[t].def, &pose[t], t), *from = &l->tool[t].capsule;
        double tip2 = 0, tail2 = 0;
        for (int c = 0; c < 3; c++) tip2 += (to.tip_m[c] - from->tip_m[c]) * (to.tip_m[c] - from->tip_m[c]);
        for (int c = 0; c < 3; c++) tail2 += (to.tail_m[c] - from->tail_m[c]) * (to.tail_m[c] - from->tail_m[c]);
        if (pose[t].active || tms_contact_solver_can_touch(&l->tool[t]))
            most = fmax(most, sqrt(fmax(tip2, tail2)) / (TMS_PATH_STEP * l->tool[t].def.radius_m));
    }
    return most;
}

/* Saves or restores the state, for an increment that does not converge. */
static void save(tms_contact_solver *l, bool back) {
    for (int32_t s = 0; s < l->capacity; s++)
        for (int c = 0; c < 3; c++)
            *(back ? &l->f[3 * s + c] : &l->f_saved[3 * s + c]) = back ? l->f_saved[3 * s + c] : l->f[3 * s + c];
}

static void go_to(tms_contact_solver *l, const tm_tool_pose *from, const tm_tool_pose *to, double s) {
    for (int32_t t = 0; t < l->tool_count; t++) {
        tm_tool_pose at = to[t];
        for (int c = 0; c < 3 && s < 1; c++) at.tip_m[c] = from[t].tip_m[c] + s * (to[t].tip_m[c] - from[t].tip_m[c]);
        for (int c = 0; c < 3 && s < 1 && l->tool[t].def.is_free; c++)
            at.direction[c] = from[t].direction[c] + s * (to[t].direction[c] - from[t].direction[c]);
        tms_contact_solver_move(l, t, &at);
    }
}

int32_t tms_contact_solver_update(tms_contact_solver *l, const tm_tool_pose *pose) {
    tm_tool_pose from[TM_MAX_INSTRUMENTS];
    const double whole = l->tool_count ? fmax(path_pieces(l, pose), 1) : 1;
    double done = 0, piece = 1 / whole;
    int32_t steps = 0;
    for (int32_t t = 0; t < l->tool_count; t++) from[t] = l->tool[t].pose;
    bool worked = false; /* jaws close at the end of the path */
    for (int32_t solves = 1; done < 1; solves++) {
        const bool last_chance = solves >= TMS_MAX_SOLVES || piece * whole < 1.0 / 64;
        const double to = last_chance && solves >= TMS_MAX_SOLVES ? 1 : fmin(1, done + piece);
        save(l, false);
        go_to(l, from, pose, to);
        if (to >= 1 && !worked) tms_contact_solver_work_jaws(l), worked = true;
        tms_contact_solver_follow_jaws(l);
        tms_contact_solver_gather(l);
        if (!tms_contact_solver_friction_knows(l)) tms_contact_solver_shape(l), tms_contact_solver_friction_learn(l);
        steps = tms_contact_solver_solve(l);
        if (!l->converged && !last_chance) { /* too far: restores, and halves the increment */
            save(l, true);
            piece *= 0.5;
            continue;
        }
        if (l->converged) tms_contact_solver_slip(l);
        tms_contact_solver_friction_settle(l, (to - done) * l->update_s);
        done = to;
        piece = fmin(2 * piece, 1 / whole);
    }
    return steps;
}

uint32_t tms_contact_solver_flags(const tms_contact_solver *l, int32_t t) {
    return (l->now.capped[t] ? TM_REACTION_CAPPED : 0u) | (l->tool[t].overflowed ? TM_REACTION_OVERFLOWED : 0u) |
           (l->converged ? 0u : TM_REACTION_UNCONVERGED) |
           (l->grasp_of[t].state == TM_GRASP_RELEASING ? TM_REACTION_RELEASING : 0u);
}

tm_tool_reaction tms_contact_solver_reaction(const tms_contact_solver *l, int32_t t) {
    const tms_tool *tool = &l->tool[t];
    tm_tool_reaction r = {.flags = tms_contact_solver_flags(l, t)};
    memcpy(r.tip_m, tool->pose.tip_m, sizeof r.tip_m);
    tms_contact_solver_force(l, t, r.force_N, r.resultant_N);
    for (int32_t i = 0; i < l->now.count; i++)
        r.row_count += l->now.row[i].instrument == t && l->now.row[i].lambda_N > 0;
    return r;
}
