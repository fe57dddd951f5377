/* The on-line system: the path of the tools, and what it comes to. Slots are in slots.c, jaws in grip.c, rows and
 * forces in look.c, the matrix in matrix.c, the quick steps in secant.c, Newton's method in newton.c: each leans on
 * those before it. */
#include "local_eval.h"

#include <math.h>
#include <string.h>

/* How long the path is, in pieces. */
static double path_pieces(const tms_local *l, const tm_tool_pose *pose) {
    double most = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        const tm_capsule to = tm_tool_capsule(&l->tool[t].def, &pose[t], t), *from = &l->tool[t].capsule;
        double tip2 = 0, tail2 = 0;
        for (int c = 0; c < 3; c++) tip2 += (to.tip_m[c] - from->tip_m[c]) * (to.tip_m[c] - from->tip_m[c]);
        for (int c = 0; c < 3; c++) tail2 += (to.tail_m[c] - from->tail_m[c]) * (to.tail_m[c] - from->tail_m[c]);
        if (pose[t].active || tms_local_can_touch(&l->tool[t]))
            most = fmax(most, sqrt(fmax(tip2, tail2)) / (TMS_PIECE * l->tool[t].def.radius_m));
    }
    return most;
}

/* What a piece that does not converge is undone to. */
static void save(tms_local *l, bool back) {
    for (int32_t s = 0; s < l->capacity; s++)
        for (int c = 0; c < 3; c++)
            *(back ? &l->f[3 * s + c] : &l->f_saved[3 * s + c]) = back ? l->f_saved[3 * s + c] : l->f[3 * s + c];
}

static void go_to(tms_local *l, const tm_tool_pose *from, const tm_tool_pose *to, double s) {
    for (int32_t t = 0; t < l->tool_count; t++) {
        tm_tool_pose at = to[t];
        for (int c = 0; c < 3 && s < 1; c++) at.tip_m[c] = from[t].tip_m[c] + s * (to[t].tip_m[c] - from[t].tip_m[c]);
        tms_local_pose(l, t, &at);
    }
}

int32_t tms_local_update(tms_local *l, const tm_tool_pose *pose) {
    tm_tool_pose from[TM_MAX_INSTRUMENTS];
    const double whole = l->tool_count ? fmax(path_pieces(l, pose), 1) : 1;
    double done = 0, piece = 1 / whole;
    int32_t steps = 0;
    for (int32_t t = 0; t < l->tool_count; t++) from[t] = l->tool[t].pose;
    bool worked = false; /* jaws close where the path ends */
    for (int32_t solves = 1; done < 1; solves++) {
        const bool last_chance = solves >= TMS_MAX_SOLVES || piece * whole < 1.0 / 64;
        const double to = last_chance && solves >= TMS_MAX_SOLVES ? 1 : fmin(1, done + piece);
        save(l, false);
        go_to(l, from, pose, to);
        if (to >= 1 && !worked) tms_local_work_jaws(l), worked = true;
        tms_local_follow_jaws(l);
        tms_local_gather(l);
        if (!tms_local_rub_knows(l)) tms_local_shape(l), tms_local_rub_learn(l);
        steps = tms_local_solve(l);
        if (!l->converged && !last_chance) { /* it was too far: back, and half of it */
            save(l, true);
            piece *= 0.5;
            continue;
        }
        if (l->converged) tms_local_slip(l);
        tms_local_rub_settle(l, (to - done) * l->update_s);
        done = to;
        piece = fmin(2 * piece, 1 / whole);
    }
    return steps;
}

uint32_t tms_local_flags(const tms_local *l, int32_t t) {
    return (l->now.capped[t] ? TM_REACTION_CAPPED : 0u) | (l->tool[t].overflowed ? TM_REACTION_OVERFLOWED : 0u) |
           (l->converged ? 0u : TM_REACTION_UNCONVERGED) |
           (l->hold[t].state == TM_GRASP_LETTING_GO ? TM_REACTION_LETTING_GO : 0u);
}

tm_tool_reaction tms_local_reaction(const tms_local *l, int32_t t) {
    const tms_tool *tool = &l->tool[t];
    tm_tool_reaction r = {.flags = tms_local_flags(l, t)};
    memcpy(r.tip_m, tool->pose.tip_m, sizeof r.tip_m);
    tms_local_force(l, t, r.force_N, r.resultant_N);
    for (int32_t i = 0; i < l->now.count; i++)
        r.row_count += l->now.row[i].instrument == t && l->now.row[i].lambda_N > 0;
    return r;
}
