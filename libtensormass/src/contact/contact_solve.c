/* Makes the rows of all tools non-penetrating by projected Gauss-Seidel: a fixed number of sweeps in a fixed order,
 * from the previous multipliers. Weighted by A = m/dt2 + gamma/2dt, so that the multipliers are the reactions in
 * newtons, exact in equilibrium. */
#include "contact/contact_internal.h"

#include <string.h>

#include "base/vec.h"
#include "contact_law/compliance.h"

/* Maximum speed at which penetration is undone that the tool's motion did not cause: a tool placed into tissue, capped
 * rows, or surface that another tool moved into this one. Without it tissue would be thrown out. It is above any speed
 * of a hand. No hand supplies that work, so its power is limited too, and it is taken from the energy that contact took
 * before (contact_passivity.c). */
#define RECOVERY_M_S 0.5
#define RECOVERY_W 0.02

double tm_contact_compliance_depth(double compliance_m_N, double radius_m, double lambda_N) {
    return law_compliance_depth(compliance_m_N, LAW_COMPLIANCE_TRAVEL * radius_m, lambda_N);
}

double tm_contact_compliance_slope(double compliance_m_N, double radius_m, double lambda_N) {
    return law_compliance_slope(compliance_m_N, LAW_COMPLIANCE_TRAVEL * radius_m, lambda_N);
}

double tm_contact_compliance_reaction(double compliance_m_N, double radius_m, double gap_m, double diagonal_m_N,
                                      double cap_N) {
    return law_compliance_reaction(compliance_m_N, LAW_COMPLIANCE_TRAVEL * radius_m, gap_m, diagonal_m_N, cap_N);
}

static double recovery_m_s(const tm_contact *contact, int32_t t, double way_m) {
    const double load_N = contact->tool[t].load_N;
    const double power_W = law_min(RECOVERY_W, tm_contact_spare_J(contact, t, way_m) / contact->world->state.dt_s);
    return RECOVERY_M_S * load_N <= power_W ? RECOVERY_M_S : power_W / load_N;
}

static void prepare_row(const tm_contact *contact, const tm_contact_row *row, tm_solver_row *r) {
    const tm_world *world = contact->world;
    const tm_tool *tool = contact->tool + row->instrument;
    double before[3];
    tm_capsule_station(&tool->previous, row->station, before);
    vsub(row->point_m, before, r->moved_m);
    r->compliance = contact->def.contact_compliance_m_N / row->share;
    r->diagonal = r->weight2 = 0;
    memset(r->drag_N, 0, sizeof r->drag_N);
    for (int j = 0; j < 3; j++) {
        r->weight2 += row->weight[j] * row->weight[j] * world->mobility_s2_kg[row->vertex[j]];
        for (int c = 0; c < 3; c++) {
            int32_t dof = 3 * row->vertex[j] + c;
            r->jacobian[j][c] = row->weight[j] * row->normal[c];
            r->response[j][c] = contact->fixed[dof] ? 0 : world->mobility_s2_kg[row->vertex[j]] * r->jacobian[j][c];
            r->diagonal += r->jacobian[j][c] * r->response[j][c];
        }
    }
    /* previous depth that is not to be undone yet */
    const double dt = world->state.dt_s, way = vnorm(r->moved_m);
    double goes = way; /* both tool and tissue: motion along blended normals differs from the change of depth */
    for (int j = 0; j < 3; j++) {
        double moved[3];
        const int32_t dof = 3 * row->vertex[j];
        vsub(world->state.u_m + dof, world->state.u_prev_m + dof, moved);
        goes += row->weight[j] * vnorm(moved);
    }
    const double recovered = law_max(recovery_m_s(contact, row->instrument, way) * dt, goes);
    const double left = row->gap_m + vdot(row->normal, r->moved_m) + r->depth_m + recovered;
    r->gap_m = row->gap_m - law_min(left, 0);
}

static void push(const tm_contact_row *row, const tm_solver_row *r, double impulse_N, double *u_next_m) {
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) u_next_m[3 * row->vertex[j] + c] += r->response[j][c] * impulse_N;
}

void tm_contact_prepare(tm_contact *contact) {
    for (int32_t i = 0; i < contact->row_count; i++) {
        prepare_row(contact, contact->row + i, contact->solver + i);
        if (contact->row[i].lambda_N > 0)
            push(contact->row + i, contact->solver + i, contact->row[i].lambda_N, contact->world->state.u_next_m);
    }
}

static void relax(tm_contact *contact, tm_contact_row *row, const tm_solver_row *r) {
    const tm_state *state = &contact->world->state;
    double free_gap = r->gap_m - r->diagonal * row->lambda_N; /* the gap without this row */
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) {
            int32_t dof = 3 * row->vertex[j] + c;
            free_gap += r->jacobian[j][c] * (state->u_next_m[dof] - state->u_m[dof]);
        }
    contact->unstable |= !(fabs(free_gap) < INFINITY);
    double lambda = tm_contact_compliance_reaction(r->compliance, contact->tool[row->instrument].def.radius_m, free_gap,
                                                   r->diagonal, contact->def.force_cap_N);
    if (lambda != row->lambda_N) push(row, r, lambda - row->lambda_N, contact->world->state.u_next_m);
    row->lambda_N = lambda;
}

/* Computes the viscous drag of one row, implicitly: it brakes and never drives. None while settling: at rest there is
 * none, and in short steps it would hold tissue where it is. */
static void drag(const tm_contact *contact, const tm_contact_row *row, tm_solver_row *r) {
    const tm_world *world = contact->world;
    const tm_state *state = &world->state;
    if (row->lambda_N == 0 && r->drag_N[0] == 0 && r->drag_N[1] == 0 && r->drag_N[2] == 0)
        return; /* the case of most rows */
    const double coefficient = world->settling ? 0 : LAW_DRAG_S_M * row->lambda_N / state->dt_s;
    double wanted[3], size;
    for (int c = 0; c < 3; c++) {
        double slip = -r->moved_m[c] - r->weight2 * r->drag_N[c];
        for (int j = 0; j < 3; j++) {
            int32_t dof = 3 * row->vertex[j] + c;
            slip += row->weight[j] * (state->u_next_m[dof] - state->u_m[dof]);
        }
        wanted[c] = -coefficient * slip / (1 + coefficient * r->weight2);
    }
    size = vnorm(wanted);
    if (size > row->lambda_N) /* at most the reaction, so that their sum never pulls */
        vscale(row->lambda_N / size, wanted, wanted);
    for (int c = 0; c < 3; c++) {
        for (int j = 0; j < 3; j++)
            if (!contact->fixed[3 * row->vertex[j] + c])
                state->u_next_m[3 * row->vertex[j] + c] +=
                    world->mobility_s2_kg[row->vertex[j]] * row->weight[j] * (wanted[c] - r->drag_N[c]);
        r->drag_N[c] = wanted[c];
    }
}

void tm_contact_sweep(tm_contact *contact, int32_t sweep) {
    for (int32_t i = 0; i < contact->row_count; i++) { /* forward and backward: no row is always last */
        int32_t k = sweep % 2 ? contact->row_count - 1 - i : i;
        relax(contact, contact->row + k, contact->solver + k);
        drag(contact, contact->row + k, contact->solver + k);
    }
}
