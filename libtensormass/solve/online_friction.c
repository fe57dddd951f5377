/* Online friction (docs/friction.md): the law of the core's stage, in each shape that Newton's method evaluates. A
 * station's force is the stretch of its contact compliance since the previous solve, limited to its cone. It is
 * therefore a function of the shape, as a row's force is of its gap. Slip becomes permanent when a solution is
 * accepted. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

#define LAW_REAL double
#include "contact_law/friction.h"

bool tms_contact_solver_has_friction(const tms_contact_solver *l, int32_t tool) {
    return l->friction && l->friction->coefficient[tool].mu_static > 0;
}

/* --- one shape --- */

static void station_at(const tm_capsule *capsule, int32_t station, double at_m[3]) {
    double axis[3];
    vsub(capsule->tail_m, capsule->tip_m, axis);
    vunit(axis, axis);
    vmadd(capsule->tip_m, station * capsule->radius_m, axis, at_m);
}

/* Sums the rows of one station: their load, their normal, and the force along it. */
static double press(const tm_contact_row *row, tms_friction_station *g) {
    double load_N = 0, sum[3] = {0, 0, 0};
    for (int32_t i = g->first; i < g->first + g->count; i++) {
        load_N += row[i].lambda_N;
        vmadd(sum, row[i].lambda_N, row[i].normal, sum);
    }
    g->normal_force_N = vunit(sum, g->normal);
    return load_N;
}

static void grip_at(const tms_contact_solver *l, const tm_contact_row *row, tms_friction_station *g) {
    const tms_friction *friction = l->friction;
    const tm_friction_coefficient *c = &friction->coefficient[row[g->first].instrument];
    const int32_t t = row[g->first].instrument, station = row[g->first].station;
    const tms_friction_state *was = &friction->state[t][station];
    const double compliance = l->def.contact_compliance_m_N, load_N = press(row, g);
    double here[3], there[3], way[3];
    g->load_N = load_N;
    g->slips = false;
    memset(g->force_N, 0, sizeof g->force_N);
    if (!(load_N > 0)) return;
    station_at(&l->tool[t].capsule, station, here);
    station_at(&friction->capsule[t], station, there);
    vsub(here, there, way);
    for (int32_t i = g->first; i < g->first + g->count; i++)
        for (int k = 0; k < 9; k++) {
            const int64_t d = 3 * (int64_t)row[i].vertex[k / 3] + k % 3;
            way[k % 3] -= row[i].lambda_N / load_N * row[i].weight[k / 3] * (l->u_m[d] - friction->u_m[d]);
        }
    for (int k = 0; k < 3; k++) g->force_N[k] = was->force_N[k] + way[k] / compliance;
    law_across(g->normal, g->force_N);
    g->stretch_N = vnorm(g->force_N);
    g->slips = law_friction_slips(
        law_friction_coefficient(c->mu_static, c->mu_kinetic, was->stick_state) * g->normal_force_N, g->force_N);
}

static void add_grip(const tms_contact_solver *l, tms_contact_eval *look, const tms_friction_station *g) {
    for (int32_t i = g->first; i < g->first + g->count && g->load_N > 0; i++) {
        const tm_contact_row *row = look->row + i;
        const tms_tool *tool = &l->tool[row->instrument];
        double on_tool[3], at_tip[3];
        vscale(-row->lambda_N / g->load_N, g->force_N, on_tool);
        tm_tool_tip_force(&tool->def, &tool->pose, row->point_m, on_tool, at_tip);
        vmadd(look->force_N[row->instrument], 1, at_tip, look->force_N[row->instrument]);
        vmadd(look->resultant_N[row->instrument], 1, on_tool, look->resultant_N[row->instrument]);
        for (int k = 0; k < 9; k++)
            look->fc[3 * l->slot_of[row->vertex[k / 3]] + k % 3] -= row->weight[k / 3] * on_tool[k % 3];
    }
}

void tms_contact_solver_friction(const tms_contact_solver *l, tms_contact_eval *look) {
    look->station_count = 0;
    for (int32_t i = 0; i < look->count; i++) {
        const tm_contact_row *row = look->row + i, *before = row - 1;
        if (!tms_contact_solver_has_friction(l, row->instrument)) continue;
        if (look->station_count == 0 || before->instrument != row->instrument || before->station != row->station)
            look->station[look->station_count++] = (tms_friction_station){.first = i};
        look->station[look->station_count - 1].count++;
    }
    for (int32_t k = 0; k < look->station_count; k++) {
        grip_at(l, look->row, &look->station[k]);
        add_grip(l, look, &look->station[k]);
    }
}

/* --- known part of the matrix --- */

/* Computes the derivative of a station's force by the tissue's motion, times the contact compliance. Sticking: across
 * the normal. Slipping: smaller, and also across the force. */
static void answer(const tms_friction_station *g, double K[3][3]) {
    const double size2 = vdot(g->force_N, g->force_N), share = g->slips ? sqrt(size2) / g->stretch_N : 1;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            const double along = g->slips && size2 > 0 ? g->force_N[a] * g->force_N[b] / size2 : 0;
            K[a][b] = share * ((a == b) - g->normal[a] * g->normal[b] - along);
        }
}

void tms_contact_solver_add_friction_matrix(tms_contact_solver *l, const tms_friction_station *g, int32_t m) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double K[3][3], *move = l->step; /* of each unknown's force along one axis */
    if (!(g->load_N > 0) || (g->slips && !(g->stretch_N > 0))) return;
    answer(g, K);
    for (int axis = 0; axis < 3; axis++) {
        memset(move, 0, 8 * (size_t)m);
        for (int32_t i = g->first; i < g->first + g->count; i++)
            for (int k = 0; k < 3; k++) {
                const tm_contact_row *row = &l->now.row[i];
                const double *C = l->block + (3 * l->slot_of[row->vertex[k]] + axis) * c3,
                             W = row->lambda_N / g->load_N * row->weight[k] / l->def.contact_compliance_m_N;
                for (int32_t j = 0; j < m && W != 0; j++) move[j] += W * C[3 * l->active[j / 3] + j % 3];
            }
        for (int32_t i = g->first; i < g->first + g->count; i++)
            for (int a = 0; a < 9; a++) {
                const tm_contact_row *row = &l->now.row[i];
                const double W = row->lambda_N / g->load_N * row->weight[a / 3] * K[a % 3][axis];
                double *out = l->lu + (int64_t)(3 * l->active_of[l->slot_of[row->vertex[a / 3]]] + a % 3) * m;
                for (int32_t j = 0; j < m && W != 0; j++) out[j] += W * move[j];
            }
    }
}

/* --- between solutions --- */

/* Sets the reference of travel: the shape under the forces of the previous solve, at each slot. */
static void count_from_here(tms_contact_solver *l) {
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int64_t d = 3 * (int64_t)l->vertex[l->used[i / 3]] + i % 3;
        l->friction->u_m[d] = l->u_m[d];
        l->friction->known_solution[l->vertex[l->used[i / 3]]] = l->friction->solution;
    }
}

bool tms_contact_solver_friction_knows(const tms_contact_solver *l) {
    bool known = true;
    for (int32_t i = 0; l->friction && i < l->used_count && known; i++)
        known = l->friction->known_solution[l->vertex[l->used[i]]] == l->friction->solution;
    return known;
}

void tms_contact_solver_friction_learn(tms_contact_solver *l) {
    for (int32_t i = 0; i < l->used_count; i++) {
        const int32_t v = l->vertex[l->used[i]];
        if (l->friction->known_solution[v] == l->friction->solution) continue;
        memcpy(l->friction->u_m + 3 * (int64_t)v, l->u_m + 3 * (int64_t)v, 24);
        l->friction->known_solution[v] = l->friction->solution;
    }
}

static void settle(tms_contact_solver *l, const tms_friction_station *g, double passed_s) {
    const tm_contact_row *row = &l->now.row[g->first];
    tms_friction_state *was = &l->friction->state[row->instrument][row->station];
    const double slipped = g->slips ? (g->stretch_N - vnorm(g->force_N)) * l->def.contact_compliance_m_N : 0;
    was->stick_state = law_stick_state(was->stick_state, slipped, passed_s);
    vset(g->force_N, was->force_N);
}

void tms_contact_solver_friction_settle(tms_contact_solver *l, double passed_s) {
    tms_friction *friction = l->friction;
    if (!friction) return;
    int32_t k = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        for (int32_t s = 0; s < TMS_STATIONS; s++) {
            const tms_friction_station *g = &l->now.station[k];
            if (k < l->now.station_count && l->now.row[g->first].instrument == t && l->now.row[g->first].station == s) {
                if (g->load_N > 0)
                    settle(l, g, passed_s);
                else
                    friction->state[t][s] = (tms_friction_state){.stick_state = 1};
                k++;
            } else
                friction->state[t][s] = (tms_friction_state){.stick_state = 1};
        }
        friction->capsule[t] = l->tool[t].capsule;
    }
    friction->solution++;
    count_from_here(l);
}

void tms_contact_solver_friction_place(tms_contact_solver *l, int32_t t) {
    if (!l->friction) return;
    for (int32_t s = 0; s < TMS_STATIONS; s++) l->friction->state[t][s] = (tms_friction_state){.stick_state = 1};
    l->friction->capsule[t] = l->tool[t].capsule;
}

tms_friction *tms_friction_create(const tm_friction_def *def, const tm_contact_def *contact, int32_t vertex_count) {
    tms_friction *friction = tms_alloc_zeroed(1, sizeof *friction);
    if (!friction) return NULL;
    friction->u_m = tms_alloc_zeroed((size_t)vertex_count, 24);
    friction->known_solution = tms_alloc_zeroed((size_t)vertex_count, sizeof *friction->known_solution);
    for (int i = 0; i < 2; i++)
        friction->station[i] = tms_alloc_zeroed((size_t)contact->max_rows, sizeof(tms_friction_station));
    friction->solution = 1;
    for (int t = 0; t < contact->instrument_count; t++) {
        friction->coefficient[t] = def->instrument[t];
        for (int32_t s = 0; s < TMS_STATIONS; s++) friction->state[t][s].stick_state = 1;
    }
    if (friction->u_m && friction->known_solution && friction->station[0] && friction->station[1]) return friction;
    tms_friction_destroy(friction);
    return NULL;
}

void tms_friction_destroy(tms_friction *friction) {
    if (!friction) return;
    tms_free(friction->u_m);
    tms_free(friction->known_solution);
    tms_free(friction->station[0]);
    tms_free(friction->station[1]);
    tms_free(friction);
}
