/* Sweeps of the rows: projected Gauss-Seidel from the forces of the last substep, with viscous drag and friction. The
 * same law as instruments have (contact_law). Each row pushes its two sides by one force and its opposite. */
#include "touch/touch_internal.h"

#include <math.h>

#include "base/vec.h"
#include "touch/touch_law.h"

/* Maximum speed at which overlap is undone that the tissue's own motion did not cause. */
#define RECOVERY_M_S 0.5

void tm_touch_push(tm_touching *t, int32_t i, const double force_N[3]) {
    double *u_next = t->world->state.u_next_m;
    for (int j = 0; j < 4; j++)
        for (int c = 0; c < 3; c++) u_next[3 * t->row[i].vertex[j] + c] += t->solver[i].response[j][c] * force_N[c];
}

/* Computes the relative motion of the two sides in this substep, of the last one or of the present. */
void tm_touch_slip(const tm_touching_row *row, const double *to_m, const double *from_m, double way_m[3]) {
    for (int c = 0; c < 3; c++) {
        way_m[c] = 0;
        for (int j = 0; j < 4; j++)
            way_m[c] += row->weight[j] * (to_m[3 * row->vertex[j] + c] - from_m[3 * row->vertex[j] + c]);
    }
}

static bool has_friction(const tm_touching *t) { return t->def.mu_static > 0 || t->world->settling; }

void tm_touch_prepare_row(tm_touching *t, int32_t i) {
    const tm_world *world = t->world;
    const tm_touching_row *row = t->row + i;
    tm_touch_solver *s = t->solver + i;
    for (int j = 0; j < 4; j++) {
        const double mobility = world->mobility_s2_kg[row->vertex[j]];
        bool free_axis = false;
        for (int c = 0; c < 3; c++) {
            const bool fixed = t->fixed[3 * row->vertex[j] + c];
            free_axis |= !fixed;
            s->response[j][c] = fixed ? 0 : row->weight[j] * mobility;
            s->diagonal_m_N += row->weight[j] * row->normal[c] * s->response[j][c] * row->normal[c];
        }
        if (free_axis) s->weight2_m_N += row->weight[j] * row->weight[j] * mobility;
    }
    double way[3], force[3];
    if (!has_friction(t)) vset((const double[3]){0, 0, 0}, s->friction_N); /* from settling (world->settle_friction) */
    tm_touch_slip(row, world->state.u_m, world->state.u_prev_m, way);
    const double undone = law_max(RECOVERY_M_S * world->state.dt_s, vnorm(way));
    const double over = -row->gap_m - touch_law_depth(s->compliance_m_N, s->soft_m, row->lambda_N) - undone;
    s->gap_m += law_max(over, 0);
    vscale(row->lambda_N, row->normal, force);
    for (int c = 0; c < 3; c++) force[c] += s->drag_N[c] + s->friction_N[c];
    tm_touch_push(t, i, force);
}

void tm_touch_prepare(tm_touching *t) {
    for (int32_t i = 0; i < t->row_count; i++) tm_touch_prepare_row(t, i);
}

static void relax(tm_touching *t, int32_t i, const double way_m[3], double cap_N) {
    tm_touching_row *row = t->row + i;
    const tm_touch_solver *s = t->solver + i;
    const double free_gap = s->gap_m - s->diagonal_m_N * row->lambda_N + vdot(row->normal, way_m);
    t->world->unstable |= !(fabs(free_gap) < INFINITY);
    const double lambda = touch_law_reaction(s->compliance_m_N, s->soft_m, free_gap, s->diagonal_m_N, cap_N);
    if (lambda == row->lambda_N) return;
    double change[3];
    vscale(lambda - row->lambda_N, row->normal, change);
    tm_touch_push(t, i, change);
    row->lambda_N = lambda;
}

/* Replaces a force along the surfaces by another. */
static void change_to(tm_touching *t, int32_t i, double force_N[3], const double wanted_N[3]) {
    double change[3];
    vsub(wanted_N, force_N, change);
    tm_touch_push(t, i, change);
    vset(wanted_N, force_N);
}

/* Viscous drag, implicitly: it brakes and never drives; at most the reaction. None while settling: at rest there is
 * none, and against the fictitious masses it could hide a residual. */
static void drag(tm_touching *t, int32_t i) {
    const tm_touching_row *row = t->row + i;
    tm_touch_solver *s = t->solver + i;
    double way[3], wanted[3];
    tm_touch_slip(row, t->world->state.u_next_m, t->world->state.u_m, way);
    const bool braked = !t->world->settling || t->world->settle_drag;
    const double coefficient = braked ? LAW_DRAG_S_M * row->lambda_N / t->world->state.dt_s : 0;
    for (int c = 0; c < 3; c++)
        wanted[c] = -coefficient * (way[c] - s->weight2_m_N * s->drag_N[c]) / (1 + coefficient * s->weight2_m_N);
    const double size = vnorm(wanted);
    if (size > row->lambda_N) vscale(row->lambda_N / size, wanted, wanted);
    change_to(t, i, s->drag_N, wanted);
}

static double friction(const tm_touching *t, double coefficient) {
    return t->world->settling ? law_max(coefficient, t->world->settle_friction) : coefficient;
}

/* Coulomb friction: holds the surfaces still within the cone of the static coefficient, else slides at the kinetic
 * one. */
static void rub(tm_touching *t, int32_t i) {
    const tm_touching_row *row = t->row + i;
    tm_touch_solver *s = t->solver + i;
    double way[3], wanted[3];
    tm_touch_slip(row, t->world->state.u_next_m, t->world->state.u_m, way);
    for (int c = 0; c < 3; c++) wanted[c] = s->weight2_m_N > 0 ? s->friction_N[c] - way[c] / s->weight2_m_N : 0;
    vmadd(wanted, -vdot(wanted, row->normal), row->normal, wanted);
    const double size = vnorm(wanted), kinetic = friction(t, t->def.mu_kinetic) * row->lambda_N;
    s->slips = size > (s->slips ? kinetic : friction(t, t->def.mu_static) * row->lambda_N);
    if (s->slips) vscale(kinetic / size, wanted, wanted);
    change_to(t, i, s->friction_N, wanted);
}

void tm_touch_sweep_once(tm_touching *t, int32_t sweep) {
    for (int32_t k = 0; k < t->row_count; k++) { /* forward and backward: no row is always last */
        const int32_t i = sweep % 2 ? t->row_count - 1 - k : k;
        double way[3];
        tm_touch_slip(t->row + i, t->world->state.u_next_m, t->world->state.u_m, way);
        const double was = t->row[i].lambda_N;
        relax(t, i, way, t->def.force_cap_N);
        if (was == 0 && t->row[i].lambda_N == 0 && vdot(t->solver[i].drag_N, t->solver[i].drag_N) == 0 &&
            vdot(t->solver[i].friction_N, t->solver[i].friction_N) == 0)
            continue; /* the case of most rows */
        drag(t, i);
        if (has_friction(t)) rub(t, i);
    }
}

void tm_touch_release(tm_touching *t, int32_t sweep) {
    for (int32_t k = 0; k < t->row_count; k++) {
        const int32_t i = sweep % 2 ? k : t->row_count - 1 - k;
        tm_touch_solver *s = t->solver + i;
        const double was = t->row[i].lambda_N;
        double way[3], wanted[3];
        if (was == 0) continue;
        tm_touch_slip(t->row + i, t->world->state.u_next_m, t->world->state.u_m, way);
        relax(t, i, way, was);
        const double share = t->row[i].lambda_N / was;
        if (share == 1) continue;
        vscale(share, s->drag_N, wanted);
        change_to(t, i, s->drag_N, wanted);
        vscale(share, s->friction_N, wanted);
        change_to(t, i, s->friction_N, wanted);
    }
}

void tm_touch_forces(const void *self, void *to, tm_add_force *add) {
    const tm_touching *t = self;
    for (int32_t i = 0; i < t->row_count; i++) {
        const tm_touching_row *row = t->row + i;
        double force[3], share[3];
        if (row->lambda_N == 0) continue;
        vmadd(row->across_N, row->lambda_N, row->normal, force);
        for (int j = 0; j < 4; j++) {
            vscale(row->weight[j], force, share);
            add(to, row->vertex[j], share);
        }
    }
}

double tm_touch_stored_at_J(const tm_touching *t, int32_t row, double lambda_N) {
    const tm_touch_solver *s = t->solver + row;
    return s->compliance_m_N > 0 ? touch_law_energy(s->compliance_m_N, s->soft_m, lambda_N) : 0;
}

double tm_touching_stored_J(const tm_touching *t, int32_t row) {
    return tm_touch_stored_at_J(t, row, t->row[row].lambda_N);
}

double tm_touching_slope_m_N(const tm_touching *t, int32_t row, bool *sticks) {
    const tm_touch_solver *s = t->solver + row;
    *sticks = t->def.mu_static > 0 && !s->slips;
    return touch_law_slope(s->compliance_m_N, s->soft_m, t->row[row].lambda_N);
}

void tm_touch_remember(tm_touching *t) {
    t->memory_count = 0;
    for (int32_t i = 0; i < t->row_count; i++) {
        tm_touching_row *row = t->row + i;
        const tm_touch_solver *s = t->solver + i;
        for (int c = 0; c < 3; c++) row->across_N[c] = s->drag_N[c] + s->friction_N[c];
        if (row->lambda_N == 0 || i >= t->persistent_count) continue;
        tm_touch_memory *m = t->memory + t->memory_count++;
        *m = (tm_touch_memory){
            .edges = row->edges, .a = row->a, .b = row->b, .slips = s->slips, .lambda_N = row->lambda_N};
        vset(s->drag_N, m->drag_N);
        vset(s->friction_N, m->friction_N);
    }
    tm_touch_remember_inside(t);
}
