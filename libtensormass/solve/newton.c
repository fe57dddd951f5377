/* Newton's method on r(f) = f - rows(base + C f), and the derivative of what it converged to. */
#include "local.h"
#include "local_eval.h"

#include <math.h>
#include <string.h>

static const double CONVERGED = 1e-10; /* of the largest force */

/* Residual of every slot in use: newtons; metres where a displacement is imposed. */
static double residual(tms_local *l) {
    double merit = 0;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    for (int32_t i = 0; i < l->use_count; i++) {
        const int32_t s = l->use[i], pin = l->pin_of[s];
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * s + c;
            const double own = l->block[d * c3 + d], free_r = l->f[d] - l->fc[d];
            const bool pinned = pin >= 0 && own > 0; /* a fixed component stays where it is */
            l->r[d] = pinned ? l->u_m[3 * (int64_t)l->vertex[s] + c] - l->pin[pin].u_m[c] + l->pin_compliance_m_N * free_r : free_r;
            merit += pinned ? l->r[d] * l->r[d] : own * own * l->r[d] * l->r[d];
        }
    }
    return merit;
}

static double evaluate(tms_local *l) {
    tms_local_shape(l);
    tms_local_rows(l, l->row, &l->row_count);
    return residual(l);
}

/* Small enough: each residual as the displacement it makes, against the largest that the forces make. */
static bool small_enough(const tms_local *l) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double most = 1e-15, worst = 0;
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * l->use[i] + c;
            const double own = l->block[d * c3 + d], scale = l->pin_of[l->use[i]] >= 0 && own > 0 ? 1 : own;
            most = fmax(most, fabs(own * l->f[d]));
            worst = fmax(worst, fabs(scale * l->r[d]));
        }
    return worst <= CONVERGED * most;
}

/* Slots whose force is unknown: under a row, loaded, or held. */
static void choose_act(tms_local *l) {
    for (int32_t s = 0; s < l->capacity; s++) l->act_of[s] = -1;
    for (int32_t i = 0; i < l->row_count; i++)
        for (int k = 0; k < 3; k++) l->act_of[l->slot_of[l->row[i].vertex[k]]] = 0;
    l->act_count = 0;
    for (int32_t i = 0; i < l->use_count; i++) {
        const int32_t s = l->use[i];
        const bool loaded = l->f[3 * s] != 0 || l->f[3 * s + 1] != 0 || l->f[3 * s + 2] != 0;
        if (l->act_of[s] < 0 && !loaded && l->pin_of[s] < 0) continue;
        l->act_of[s] = l->act_count;
        l->act[l->act_count++] = s;
    }
}

/* lu := lu + D C for one row. */
static void add_row_matrix(tms_local *l, const tm_contact_row *row, bool turning, int32_t m) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double x[3][3], D[81];
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++) x[k][c] = l->mesh->rest_m[3 * (int64_t)row->vertex[k] + c] + l->u_m[3 * (int64_t)row->vertex[k] + c];
    tms_row_stiffness(row, x, l->tool[row->instrument].def.radius_m, l->def.skin_compliance_m_N, l->def.force_cap_N, turning, D);
    for (int a = 0; a < 9; a++) {
        double *out = l->lu + (int64_t)(3 * l->act_of[l->slot_of[row->vertex[a / 3]]] + a % 3) * m;
        for (int b = 0; b < 9; b++) {
            if (D[9 * a + b] == 0) continue;
            const double *C = l->block + (3 * l->slot_of[row->vertex[b / 3]] + b % 3) * c3;
            for (int32_t j = 0; j < l->act_count; j++)
                for (int c = 0; c < 3; c++) out[3 * j + c] += D[9 * a + b] * C[3 * l->act[j] + c];
        }
    }
}

bool tms_local_factor(tms_local *l, bool turning) {
    choose_act(l);
    const int32_t m = 3 * l->act_count;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    memset(l->lu, 0, sizeof(double) * (size_t)m * (size_t)m);
    for (int32_t i = 0; i < l->row_count; i++)
        if (l->row[i].lambda_N > 0) add_row_matrix(l, &l->row[i], turning, m);
    for (int32_t i = 0; i < m; i++) l->lu[(int64_t)i * m + i] += 1;
    for (int32_t i = 0; i < l->act_count; i++) {
        if (l->pin_of[l->act[i]] < 0) continue;
        for (int c = 0; c < 3; c++) {
            double *row = l->lu + (int64_t)(3 * i + c) * m;
            const double *C = l->block + (3 * l->act[i] + c) * c3;
            if (!(C[3 * l->act[i] + c] > 0)) continue;
            for (int32_t j = 0; j < m; j++) row[j] = C[3 * l->act[j / 3] + j % 3] + l->pin_compliance_m_N * row[j];
        }
    }
    return tms_lu(l->lu, l->pivot, m);
}

void tms_local_back(const tms_local *l, double *x) { tms_lu_solve(l->lu, l->pivot, 3 * l->act_count, x); }

/* f := keep - s * step; then the merit there. */
static double try_step(tms_local *l, double s) {
    for (int32_t i = 0; i < 3 * l->act_count; i++) {
        const int32_t d = 3 * l->act[i / 3] + i % 3;
        l->f[d] = l->keep[d] - s * l->step[i];
    }
    return evaluate(l);
}

/* One step down the merit, halved where it overshoots. False: no step of this matrix helps. */
static bool descend(tms_local *l, double *merit) {
    for (int32_t i = 0; i < 3 * l->act_count; i++) {
        const int32_t d = 3 * l->act[i / 3] + i % 3;
        l->keep[d] = l->f[d];
        l->step[i] = l->r[d];
    }
    tms_local_back(l, l->step);
    const double old = *merit;
    double s = 1;
    for (int i = 0; i <= TMS_HALVINGS; i++, s *= 0.5) {
        *merit = try_step(l, s);
        if (*merit < (1 - 0.1 * s) * old) return true;
    }
    return false;
}

int32_t tms_local_solve(tms_local *l) {
    double merit = evaluate(l);
    int32_t steps = 0;
    bool factored = false, turning = true;
    for (l->converged = small_enough(l); !l->converged && steps < TMS_NEWTON_STEPS; steps++) {
        const double old = merit;
        /* The matrix of the step before serves again as long as it brings the residual down tenfold and no new vertex came in. */
        if (!factored && !tms_local_factor(l, turning)) break;
        const bool good = descend(l, &merit);
        l->converged = small_enough(l);
        int32_t loaded = 0;
        for (int32_t i = 0; i < l->row_count; i++)
            for (int k = 0; k < 3; k++) loaded += l->act_of[l->slot_of[l->row[i].vertex[k]]] < 0;
        factored = good && merit < 0.01 * old && loaded == 0;
        if (good) turning = true;
        else if (turning) turning = false; /* beyond a snap the curvature misleads: without it every step goes down */
        else break;
    }
    l->before_count = l->row_count;
    memcpy(l->before, l->row, (size_t)l->row_count * sizeof *l->row);
    return steps;
}

/* --- derivative --- */

static void offset_shape(tms_local *l, const double *u0, const double *du, double h) {
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * l->use[i] + c;
            l->u_m[3 * (int64_t)l->vertex[l->use[i]] + c] = u0[d] + h * du[d];
        }
}

/* Change of rows' forces (on the slots, into `change`) and of the tool's tip force, along (du, tip + e_axis), by central differences. */
static void along(tms_local *l, int32_t t, int axis, const double *u0, const double *du, double *change, double dF[3]) {
    tms_tool *tool = &l->tool[t];
    const tm_tool_pose pose = tool->pose;
    const tm_capsule capsule = tool->capsule;
    double most = 1;
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) most = fmax(most, fabs(du[3 * l->use[i] + c]));
    const double h = 1e-4 * tool->def.radius_m / most;
    int32_t count;
    for (int side = 1; side >= -1; side -= 2) {
        tool->pose.tip_m[axis] = pose.tip_m[axis] + side * h;
        tool->capsule = tm_tool_capsule(&tool->def, &tool->pose, t);
        offset_shape(l, u0, du, side * h);
        tms_local_rows(l, l->row, &count);
        for (int32_t i = 0; i < l->use_count; i++)
            for (int c = 0; c < 3; c++) {
                const int32_t d = 3 * l->use[i] + c;
                change[d] = side > 0 ? l->fc[d] / (2 * h) : change[d] - l->fc[d] / (2 * h);
            }
        for (int c = 0; c < 3; c++) dF[c] = side > 0 ? tool->force_N[c] / (2 * h) : dF[c] - tool->force_N[c] / (2 * h);
    }
    tool->pose = pose;
    tool->capsule = capsule;
}

/* du := C df over the slots in use; df lives on act. */
static void response(const tms_local *l, const double *df, double *du) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) {
            const double *row = l->block + (3 * l->use[i] + c) * c3;
            double sum = 0;
            for (int32_t j = 0; j < 3 * l->act_count; j++) sum += row[3 * l->act[j / 3] + j % 3] * df[j];
            du[3 * l->use[i] + c] = sum;
        }
}

void tms_local_stiffness(tms_local *l, int32_t t, double K[9]) {
    memset(K, 0, 9 * sizeof *K);
    if (l->tool[t].row_count == 0 || !tms_local_factor(l, true)) return;
    double *u0 = l->keep, *du = l->try_u, *df = l->step, *change = l->r;
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) u0[3 * l->use[i] + c] = l->u_m[3 * (int64_t)l->vertex[l->use[i]] + c];
    /* df = d(rows)(C df, dP): the matrix at hand knows all of d(rows) but the turning of the shares, so few rounds suffice. */
    for (int axis = 0; axis < 3; axis++) {
        double dF[3] = {0};
        memset(df, 0, 24 * (size_t)l->act_count);
        for (int round = 0; round < 24; round++) {
            double worst = 0, most = 1e-12;
            response(l, df, du);
            along(l, t, axis, u0, du, change, dF);
            for (int32_t j = 0; j < 3 * l->act_count; j++) {
                const int32_t s = l->act[j / 3], d = 3 * s + j % 3;
                const double free_r = df[j] - change[d], own = l->block[d * 3 * (int64_t)l->capacity + d];
                const bool pinned = l->pin_of[s] >= 0 && own > 0;
                l->rhs[j] = pinned ? du[d] + l->pin_compliance_m_N * free_r : free_r;
                worst = fmax(worst, fabs(pinned ? l->rhs[j] / own : free_r));
                most = fmax(most, fabs(df[j]));
            }
            if (worst <= 1e-7 * most) break;
            tms_local_back(l, l->rhs);
            for (int32_t j = 0; j < 3 * l->act_count; j++) df[j] -= l->rhs[j];
        }
        for (int c = 0; c < 3; c++) K[3 * c + axis] = dF[c];
    }
    /* back to the solution, bit for bit */
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) l->u_m[3 * (int64_t)l->vertex[l->use[i]] + c] = u0[3 * l->use[i] + c];
    tms_local_rows(l, l->row, &l->row_count);
    residual(l);
}
