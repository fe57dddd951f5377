/* Fading of contact rows whose tetrahedra are removed: their force falls over time instead of in one step.
 *
 * When a tetrahedron is removed, the surface under the tool recedes by its height. The force of its faces would vanish
 * within one substep, although the tool meets the surface behind a moment later. So each row stays for a while as a
 * spring: its contact compliance, between its station and its vertices, along its normal at that time. Its force limit
 * falls linearly from its force to zero. Beyond the limit it slips, as releasing jaws do: it drives nothing, and gives
 * back no more than it stores. */
#include "contact/contact_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Returns the force limit of a row now, N. */
static double bearable(const tm_fading_rows *fading, const tm_fading_row *row) {
    return row->bore_N * law_max(1 - row->age_s / fading->fade_s, 0);
}

static bool is_of(const int32_t *tet, int32_t count, int32_t which) {
    for (int32_t i = 0; i < count; i++)
        if (tet[i] == which) return true;
    return false;
}

void tm_fading_begin(tm_fading_rows *fading, const int32_t *tet, int32_t count) {
    const tm_contact *contact = fading->contact;
    for (int32_t i = 0; i < contact->row_count && fading->count < TM_FADING_MAX; i++) {
        const tm_contact_row *row = contact->row + i;
        if (!(row->lambda_N > 0) || !is_of(tet, count, row->face / 4)) continue;
        tm_fading_row *to = fading->row + fading->count++;
        *to = (tm_fading_row){.instrument = row->instrument,
                              .station = row->station,
                              .bore_N = row->lambda_N,
                              .lambda_N = row->lambda_N,
                              .compliance_m_N = contact->def.contact_compliance_m_N / row->share};
        to->stretch_m = to->compliance_m_N * row->lambda_N;
        memcpy(to->vertex, row->vertex, sizeof to->vertex);
        memcpy(to->weight, row->weight, sizeof to->weight);
        vset(row->normal, to->normal);
    }
}

void tm_fading_drop(tm_fading_rows *fading, int32_t instrument) {
    int32_t left = 0;
    for (int32_t i = 0; i < fading->count; i++)
        if (fading->row[i].instrument != instrument) fading->row[left++] = fading->row[i];
    fading->count = left;
}

bool tm_fading_has(const tm_fading_rows *fading, int32_t instrument) {
    for (int32_t i = 0; fading && i < fading->count; i++)
        if (fading->row[i].instrument == instrument) return true;
    return false;
}

void tm_fading_age(tm_fading_rows *fading, double dt_s) {
    int32_t left = 0;
    for (int32_t i = 0; i < fading->count; i++) {
        tm_fading_row *row = fading->row + i;
        row->age_s += dt_s;
        if (row->age_s < fading->fade_s) fading->row[left++] = *row;
    }
    fading->count = left;
}

/* --- the constraint block --- */

static void push(const tm_contact *contact, const tm_fading_row *row, double force_N) {
    const tm_world *world = contact->world;
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            if (!contact->fixed[dof])
                world->state.u_next_m[dof] +=
                    world->mobility_s2_kg[row->vertex[j]] * row->weight[j] * row->normal[c] * force_N;
        }
}

/* Moves the weight of vertices without tetrahedra to the others. Returns false if none is left. */
static bool share_out(const tm_world *world, tm_fading_row *row) {
    double sum = 0;
    for (int j = 0; j < 3; j++) {
        if (!(world->mobility_s2_kg[row->vertex[j]] > 0)) row->weight[j] = 0;
        sum += row->weight[j];
    }
    for (int j = 0; j < 3 && sum > 0; j++) row->weight[j] /= sum;
    return sum > 0;
}

static void prepare(const tm_fading_rows *fading, tm_fading_row *row) {
    const tm_contact *contact = fading->contact;
    const tm_tool *tool = contact->tool + row->instrument;
    double before[3], now[3], moved[3];
    tm_capsule_station(&tool->previous, row->station, before);
    tm_capsule_station(&tool->capsule, row->station, now);
    vsub(now, before, moved);
    row->diagonal_m_N = 0;
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++)
            if (!contact->fixed[3 * row->vertex[j] + c])
                row->diagonal_m_N += contact->world->mobility_s2_kg[row->vertex[j]] * row->weight[j] * row->weight[j] *
                                     row->normal[c] * row->normal[c];
    row->pressed_m = row->stretch_m + vdot(row->normal, moved);
    row->lambda_N = law_min(row->lambda_N, bearable(fading, row));
    push(contact, row, row->lambda_N);
}

static void find(void *self, tm_world *world) {
    tm_fading_rows *fading = self;
    int32_t left = 0;
    if (world->settling) fading->count = 0; /* equilibrium has no fading rows */
    for (int32_t i = 0; i < fading->count; i++)
        if (share_out(world, fading->row + i)) fading->row[left++] = fading->row[i];
    fading->count = left;
    for (int32_t i = 0; i < fading->count; i++) prepare(fading, fading->row + i);
}

/* Returns the compression of the row's compliance at the end of the substep, with its own force. */
static double pressed(const tm_state *state, const tm_fading_row *row) {
    double depth = row->pressed_m;
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            depth -= row->weight[j] * row->normal[c] * (state->u_next_m[dof] - state->u_m[dof]);
        }
    return depth;
}

static void sweep(void *self, tm_world *world, int32_t number) {
    tm_fading_rows *fading = self;
    (void)number;
    for (int32_t i = 0; i < fading->count; i++) {
        tm_fading_row *row = fading->row + i;
        const double free_m = pressed(&world->state, row) + row->diagonal_m_N * row->lambda_N,
                     pivot = row->diagonal_m_N + row->compliance_m_N;
        fading->contact->unstable |= !(fabs(free_m) < INFINITY);
        const double lambda = free_m > 0 && pivot > 0 ? law_min(free_m / pivot, bearable(fading, row)) : 0;
        push(fading->contact, row, lambda - row->lambda_N);
        row->lambda_N = lambda;
    }
}

/* Slips the force beyond the limit. */
static void finish(void *self, tm_world *world) {
    tm_fading_rows *fading = self;
    for (int32_t i = 0; i < fading->count; i++) {
        tm_fading_row *row = fading->row + i;
        row->stretch_m = law_min(pressed(&world->state, row), row->compliance_m_N * bearable(fading, row));
    }
}

static void react(void *self, int32_t t, double force_N[3], double resultant_N[3]) {
    const tm_fading_rows *fading = self;
    const tm_tool *tool = fading->contact->tool + t;
    for (int32_t i = 0; i < fading->count; i++) {
        const tm_fading_row *row = fading->row + i;
        double at[3], on_tool[3], at_tip[3];
        if (row->instrument != t || !(row->lambda_N > 0)) continue;
        tm_capsule_station(&tool->capsule, row->station, at);
        vscale(-row->lambda_N, row->normal, on_tool);
        tm_tool_tip_force(&tool->def, &tool->pose, at, on_tool, at_tip);
        vmadd(force_N, 1, at_tip, force_N);
        vmadd(resultant_N, 1, on_tool, resultant_N);
    }
}

void tm_fading_add(tm_fading_rows *fading, const void *owner) {
    fading->contact->fading = fading;
    tm_contact_add_block_behind(fading->contact, &(tm_constraint_block){.self = fading,
                                                                        .owner = (void *)(uintptr_t)owner,
                                                                        .find = find,
                                                                        .sweep = sweep,
                                                                        .finish = finish,
                                                                        .react = react});
}

void tm_fading_remove(tm_fading_rows *fading) {
    tm_contact_remove_block(fading->contact, fading);
    fading->contact->fading = NULL;
}

/* --- snapshots --- */

bool tm_fading_fits(const tm_fading_rows *fading, const tm_fading_row *row) {
    bool good = row->instrument >= 0 && row->instrument < fading->contact->tool_count && row->station >= 0 &&
                row->station < TM_MAX_STATIONS && !row->unused && row->bore_N >= 0 && row->lambda_N >= 0 &&
                row->age_s >= 0 && row->compliance_m_N >= 0 && isfinite(row->bore_N + row->lambda_N + row->age_s) &&
                isfinite(row->compliance_m_N + row->stretch_m);
    for (int j = 0; j < 3; j++)
        good = good && row->vertex[j] >= 0 && row->vertex[j] < fading->contact->world->tissue->mesh->vertex_count &&
               row->weight[j] >= 0 && row->weight[j] <= 1 && fabs(row->normal[j]) <= 1.001;
    return good;
}
