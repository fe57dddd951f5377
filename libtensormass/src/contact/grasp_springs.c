/* Springs between jaws and tissue: their force limits, their part of the sweeps, and a limit on the energy they
 * generate.
 *
 * A spring whose force equals its stretch over compliance, solved at the end of the substep, gives back no more than it
 * stores. That does not hold for slip between substeps, a spring that starts on moving tissue, or two springs on one
 * vertex. Energy generated there is limited after the sweeps, exactly in the integrator's terms, as contact_passivity.c
 * does for rows. */
#include "contact/grasp_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

static const double LITTLE_J = 2e-11; /* negligible energy */

void tm_hold_vertex_at(const tm_world *world, const double *u_m, int32_t vertex, double at_m[3]) {
    for (int c = 0; c < 3; c++) at_m[c] = world->tissue->mesh->rest_m[3 * vertex + c] + u_m[3 * vertex + c];
}

static void push_vertex(const tm_grasp *grasp, tm_world *world, int32_t vertex, const double force_N[3]) {
    for (int c = 0; c < 3; c++)
        if (!grasp->contact->fixed[3 * vertex + c])
            world->state.u_next_m[3 * vertex + c] += world->mobility_s2_kg[vertex] * force_N[c];
}

/* Returns the force limit of the spring on a vertex, N: the cap; while releasing, a share of its force at opening. */
static double bearable(const tm_grasp *grasp, const grasp_of_jaw *h, int32_t i) {
    if (h->state != TM_GRASP_RELEASING) return grasp->def.force_cap_N;
    return fmin(grasp->def.force_cap_N, h->fade * vnorm(h->let_go_N + 3 * i));
}

static void limit_force(const tm_grasp *grasp, const grasp_of_jaw *h, int32_t i, double force_N[3]) {
    const double most = bearable(grasp, h, i), size = vnorm(force_N);
    if (size > most) vscale(most / size, force_N, force_N);
}

/* Slips force beyond the limit, and loses its stored energy: while releasing, the jaw is a fading friction. A constant
 * force that fades would be a dead load instead, which goes on driving tissue that another tool moves
 * (docs/grasping.md). Call before the jaw rotates. */
static void slip(const tm_grasp *grasp, grasp_of_jaw *h, const tm_world *world) {
    for (int32_t i = 0; i < h->count; i++) {
        double at[3], d[3];
        tm_hold_vertex_at(world, world->state.u_m, h->vertex[i], at);
        vsub(h->target_m + 3 * i, at, d);
        const double stretch = vnorm(d), most = grasp->def.compliance_m_N * bearable(grasp, h, i);
        for (int c = 0; c < 3 && stretch > most; c++)
            h->offset_m[3 * i + c] -= (1 - most / stretch) * vdot(d, h->jaw.axis_m[c]);
    }
}

void tm_hold_start(const tm_grasp *grasp, grasp_of_jaw *h, int32_t i, tm_world *world) {
    limit_force(grasp, h, i, h->force_N + 3 * i);
    push_vertex(grasp, world, h->vertex[i], h->force_N + 3 * i);
}

/* Solves one vertex against its spring: f = (target - x) / compliance with x at the end of the step. */
static void relax(const tm_grasp *grasp, const grasp_of_jaw *h, int32_t i, tm_world *world) {
    int32_t vertex = h->vertex[i];
    double *force = h->force_N + 3 * i, wanted[3], change[3];
    for (int c = 0; c < 3; c++) {
        int32_t dof = 3 * vertex + c;
        double mobility = grasp->contact->fixed[dof] ? 0 : world->mobility_s2_kg[vertex];
        double free_at = world->tissue->mesh->rest_m[dof] + world->state.u_next_m[dof] - mobility * force[c];
        wanted[c] = (h->target_m[3 * i + c] - free_at) / (mobility + grasp->def.compliance_m_N);
    }
    limit_force(grasp, h, i, wanted);
    vsub(wanted, force, change);
    push_vertex(grasp, world, vertex, change);
    vset(wanted, force);
}

void tm_grasp_sweep(void *self, tm_world *world, int32_t number) {
    const tm_grasp *grasp = self;
    (void)number;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++)
        for (int32_t i = 0; i < grasp->grasp[t].count; i++) relax(grasp, grasp->grasp + t, i, world);
}

/* Moves a held vertex and updates its spring within its limit. Without the limit, a released jaw would take over the
 * excess force when contact is reduced. A spring at its limit would keep its force after its tissue came nearer. */
bool tm_grasp_push(void *self, tm_world *world, int32_t vertex, const double force_N[3]) {
    const tm_grasp *grasp = self;
    bool fixed = false;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) {
        const grasp_of_jaw *h = grasp->grasp + t;
        for (int32_t i = 0; i < h->count; i++) {
            if (h->vertex[i] != vertex) continue;
            if (!fixed) push_vertex(grasp, world, vertex, force_N);
            fixed = true;
            relax(grasp, h, i, world);
        }
    }
    return fixed;
}

/* Runs one last sweep, so that each force matches its stored energy. */
void tm_grasp_finish(void *self, tm_world *world) { tm_grasp_sweep(self, world, 0); }

/* --- generated energy --- */

static double held_J(const tm_grasp *grasp, const grasp_of_jaw *h) {
    double squares = 0;
    for (int32_t i = 0; i < 3 * h->count; i++) squares += h->force_N[i] * h->force_N[i];
    return 0.5 * grasp->def.compliance_m_N * squares;
}

void tm_hold_follow(grasp_of_jaw *h, const tm_tool *tool) {
    memcpy(h->place[0].axis_m, h->jaw.axis_m, sizeof h->jaw.axis_m);
    vset(tool->pose.tip_m, h->place[0].tip_m);
}

void tm_hold_place(grasp_of_jaw *h, const tm_tool *tool) {
    tm_jaw_rotate(&h->jaw, &tool->def, &tool->pose);
    tm_hold_follow(h, tool);
    h->place[1] = h->place[2] = h->place[0];
    h->contact_stored_J[0] = h->contact_stored_J[1] = 0;
}

void tm_hold_begin(const tm_grasp *grasp, grasp_of_jaw *h, const tm_world *world) {
    h->place[2] = h->place[1];
    h->place[1] = h->place[0];
    h->contact_stored_J[1] = h->contact_stored_J[0];
    h->contact_stored_J[0] = held_J(grasp, h);
    if (world->settling) h->contact_stored_J[1] = h->contact_stored_J[0];
    slip(grasp, h, world);
}

void tm_hold_take_over(tm_grasp *grasp, grasp_of_jaw *h, int32_t t, double stored_J) {
    tm_tool *tool = grasp->contact->tool + t;
    const double held = held_J(grasp, h), may = stored_J + tm_contact_spare_J(grasp->contact, t, 0);
    const bool limited = held > may && !grasp->contact->others.solve; /* which has an account of its own */
    const double share = limited ? sqrt(may / held) : 1;
    for (int32_t i = 0; i < h->count && share < 1; i++) vscale(share, h->force_N + 3 * i, h->force_N + 3 * i);
    h->contact_stored_J[0] = h->contact_stored_J[1] = share * share * held;
    tool->reserve_J -= h->contact_stored_J[0];
}

/* Energy over two substeps with all forces scaled by `share`: share bare + share^2 own. */
typedef struct hold_work {
    double bare_J, own_J;
} hold_work;

static hold_work sum_work(const tm_grasp *grasp, const grasp_of_jaw *h, const tm_world *world) {
    const tm_state *state = &world->state;
    hold_work w = {.own_J = 0.5 * held_J(grasp, h)};
    for (int32_t i = 0; i < h->count; i++) {
        const double *force = h->force_N + 3 * i;
        double there[3];
        vset(h->place[2].tip_m, there);
        for (int c = 0; c < 3; c++) vmadd(there, h->offset_m[3 * i + c], h->place[2].axis_m[c], there);
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * h->vertex[i] + c;
            const double adds = grasp->contact->fixed[dof] ? 0 : world->mobility_s2_kg[h->vertex[i]] * force[c];
            const double way = state->u_next_m[dof] - adds - state->u_prev_m[dof];
            w.bare_J += 0.5 * force[c] * (way - (h->target_m[3 * i + c] - there[c]));
            w.own_J += 0.5 * force[c] * adds;
        }
    }
    return w;
}

/* Moves the target by the spring's stretch beyond its force. */
static void give_way(const tm_grasp *grasp, grasp_of_jaw *h, int32_t i, const tm_world *world) {
    double at[3], beyond[3];
    tm_hold_vertex_at(world, world->state.u_next_m, h->vertex[i], at);
    vsub(h->target_m + 3 * i, at, beyond);
    vmadd(beyond, -grasp->def.compliance_m_N, h->force_N + 3 * i, beyond);
    vmadd(h->target_m + 3 * i, -1, beyond, h->target_m + 3 * i);
    for (int c = 0; c < 3; c++) h->offset_m[3 * i + c] -= vdot(beyond, h->jaw.axis_m[c]);
}

static void shorten(tm_grasp *grasp, int32_t t, tm_world *world, double share) {
    grasp_of_jaw *h = grasp->grasp + t;
    for (int32_t i = 0; i < h->count; i++) {
        double change[3];
        vscale(share - 1, h->force_N + 3 * i, change);
        vscale(share, h->force_N + 3 * i, h->force_N + 3 * i);
        push_vertex(grasp, world, h->vertex[i], change);
        for (int32_t other = 0; other < grasp->contact->tool_count; other++)
            for (int32_t k = 0; other != t && k < grasp->grasp[other].count; k++)
                if (grasp->grasp[other].vertex[k] == h->vertex[i]) relax(grasp, grasp->grasp + other, k, world);
        give_way(grasp, h, i, world);
    }
}

bool tm_grasp_hold_back(void *self, tm_world *world, int32_t t) {
    tm_grasp *grasp = self;
    const grasp_of_jaw *h = grasp->grasp + t;
    if (h->count == 0) return false;
    const hold_work w = sum_work(grasp, h, world);
    const double may = LITTLE_J + 0.5 * h->contact_stored_J[1];
    if (!(w.bare_J + w.own_J > may)) return false;
    shorten(grasp, t, world, (sqrt(w.bare_J * w.bare_J + 4 * w.own_J * may) - w.bare_J) / (2 * w.own_J));
    return true;
}

double tm_grasp_lost(void *self, const tm_world *world, int32_t t) {
    const tm_grasp *grasp = self;
    const grasp_of_jaw *h = grasp->grasp + t;
    const hold_work w = sum_work(grasp, h, world);
    return law_max(0.5 * h->contact_stored_J[1] - w.bare_J - w.own_J, 0);
}
