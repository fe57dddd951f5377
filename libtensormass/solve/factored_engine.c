/* Factor of the tissue in an earlier state, columns of its compliance for the requested vertices, and the cuts since
 * then. Runs in one thread at a time and shares only constant data with the simulation (mesh, materials, fibres). */
#include "factored.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* K + sigma M: a little inertia. A fragment that a cut detaches after the factor gets a huge compliance (which no patch
 * uses). A constrained one loses sigma / omega_1^2 of its compliance, 1e-8 at 16 Hz. */
#define SIGMA_1_S2 1e-4
/* A piece without supports stands on springs that sum to this, shared by mass: so compliant that a patch is refused
 * unless other tissue holds it (patch_behind.c), and stiff enough that the columns keep their digits then. */
#define GROUND_N_M 0.1

/* For rotating tissue: limits of motion (in edges) and rotation (3 degrees, as norm of R - Q) that require a new
 * factor. They apply to a patch, or to this many vertices all over it; frames between factors have a minimum. In
 * between, columns rotate with the tissue. On a lobe lifted by 50 mm and rotated in 1.8 s, stiffnesses are within 14 %
 * of those of a factor per frame (29 % with a factor every 30 frames). */
static const double MOVED_ON = 0.1, TURNED_ON = 0.0740;
enum { MOVES_ON_AFTER = 12, LOOKED_AT = 256 };

/* A thread also solves columns that are not needed yet: if they fill a block, or if one of the first ones is missing,
 * which are the tools' next places. */
enum { AHEAD = 8 };

tms_engine *tms_engine_create(const tm_tissue *tissue, const uint8_t *fixed, bool turns) {
    tms_engine *e = tm_allocate(sizeof *e);
    if (!e) return NULL;
    memset(e, 0, sizeof *e);
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const size_t tets = (size_t)mesh->tet_count, vertices = (size_t)mesh->vertex_count;
    e->tissue = tissue;
    e->vertex_count = mesh->vertex_count;
    e->tet_count = mesh->tet_count;
    e->fixed = tm_allocate(3 * vertices);
    e->base = tm_allocate(tets);
    e->gone = tm_allocate(tets);
    e->slot_of = tm_allocate(vertices * sizeof *e->slot_of);
    e->G = tm_allocate(sizeof(double) * WIDTH * WIDTH);
    e->D = tm_allocate(sizeof(double) * MIDDLE * MIDDLE);
    e->M = tm_allocate(sizeof(double) * MIDDLE * MIDDLE);
    e->column = tm_allocate(sizeof(double) * WIDTH * TMS_BLOCK);
    e->X = tm_allocate(sizeof(double) * WIDTH * MIDDLE);
    e->has_law = tms_nonlinear_law(tissue) != NULL;
    if (turns) e->at_m = tm_allocate(3 * vertices * sizeof *e->at_m);
    if (e->has_law) e->looked_m = tm_allocate(3 * vertices * sizeof *e->looked_m);
    if ((turns && !e->at_m) || (e->has_law && !e->looked_m) || !e->fixed || !e->base || !e->gone || !e->slot_of ||
        !e->G || !e->D || !e->M || !e->column || !e->X) {
        tms_engine_destroy(e);
        return NULL;
    }
    double volume = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) volume += mesh->volume_m3[t];
    e->moved_on_m = MOVED_ON * cbrt(6 * volume / mesh->tet_count);
    memcpy(e->fixed, fixed, 3 * vertices);
    memset(e->G, 0, sizeof(double) * WIDTH * WIDTH);
    return e;
}

static void drop_factor(tms_engine *e) {
    tms_reach_destroy(e->reach);
    tms_solver_destroy(e->solver);
    tms_system_destroy(&e->system);
    e->reach = NULL;
    e->solver = NULL;
    e->ready = false;
}

void tms_engine_destroy(tms_engine *e) {
    if (!e) return;
    const size_t tets = (size_t)e->tet_count, vertices = (size_t)e->vertex_count;
    drop_factor(e);
    tm_release(e->fixed, 3 * vertices);
    tm_release(e->at_m, 3 * vertices * sizeof *e->at_m);
    tm_release(e->looked_m, 3 * vertices * sizeof *e->looked_m);
    tm_release(e->base, tets);
    tm_release(e->gone, tets);
    tm_release(e->slot_of, vertices * sizeof *e->slot_of);
    tm_release(e->G, sizeof(double) * WIDTH * WIDTH);
    tm_release(e->D, sizeof(double) * MIDDLE * MIDDLE);
    tm_release(e->M, sizeof(double) * MIDDLE * MIDDLE);
    tm_release(e->column, sizeof(double) * WIDTH * TMS_BLOCK);
    tm_release(e->X, sizeof(double) * WIDTH * MIDDLE);
    tm_release(e, sizeof *e);
}

int64_t tms_engine_bytes(const tms_engine *e) {
    return (int64_t)sizeof *e + 2 * (int64_t)e->tet_count +
           ((e->at_m ? 31 : 7) + (e->looked_m ? 24 : 0)) * (int64_t)e->vertex_count +
           (int64_t)sizeof(double) * (WIDTH * (WIDTH + TMS_BLOCK + MIDDLE) + 2 * MIDDLE * MIDDLE) +
           (e->solver ? tms_solver_bytes(e->solver) : 0) + (e->reach ? tms_reach_bytes(e->reach) : 0);
}

/* --- the factor --- */

static bool same_entries(const tms_system *a, const tms_system *b) {
    return a->n == b->n && !memcmp(a->begin, b->begin, sizeof *a->begin * ((size_t)a->n + 1)) &&
           !memcmp(a->row, b->row, sizeof *a->row * (size_t)a->begin[a->n]) &&
           !memcmp(a->dof, b->dof, sizeof *a->dof * (size_t)a->n);
}

/* Takes ownership of the system. If nothing was cut since, the factor's order and memory are reused. */
static bool take_system(tms_engine *e, tms_system *next) {
    if (e->solver && same_entries(&e->system, next)) {
        tms_system_destroy(&e->system);
        e->system = *next;
        return tms_solver_renew(e->solver, &e->system, NULL) == TM_OK;
    }
    tm_solve_report report = {0};
    tm_solve_def def = tm_solve_def_default();
    def.threads = 1;
    drop_factor(e);
    e->system = *next;
    return tms_solver_create(&e->system, &def, 0, 0, &e->solver, &report, NULL) == TM_OK &&
           (e->reach = tms_reach_create(e->solver)) != NULL;
}

/* Adds inertia, and the springs that pieces without supports stand on. */
static bool stand(const tms_engine *e, const tm_tissue *tissue, tms_system *system) {
    const double *mass = tm_tissue_mass_kg(tissue);
    double *part_kg = tms_alloc((size_t)e->vertex_count * sizeof *part_kg);
    const bool good = part_kg && tms_find_loose(tissue, e->fixed, part_kg);
    for (int32_t j = 0; good && j < system->n; j++) { /* rows ascend: a column's first entry is its diagonal */
        const int32_t v = system->dof[j] / 3;
        system->value[system->begin[j]] += part_kg[v] > 0 ? GROUND_N_M * mass[v] / part_kg[v] : SIGMA_1_S2 * mass[v];
    }
    tms_free(part_kg);
    if (!good) tms_system_destroy(system);
    return good;
}

/* Makes the factor of the base's stiffness at at_m. Returns false if that is not positive definite. */
static bool factorise_base(tms_engine *e) {
    tm_tissue *tissue = NULL;
    tms_system next = {0};
    bool good = tms_engine_partial_tissue(e, e->base, e->at_m, &tissue) &&
                tms_system_assemble(tissue, e->fixed, &next, NULL) == TM_OK;
    good = good && stand(e, tissue, &next);
    tm_tissue_destroy(tissue);
    good = good && take_system(e, &next);
    if (!good) drop_factor(e);
    return good;
}

static bool factorise(tms_engine *e, const tms_compliance_request *request) {
    const size_t bytes = 3 * (size_t)e->vertex_count * sizeof(double);
    e->ready = false;
    memcpy(e->base, request->alive, (size_t)e->tet_count);
    memset(e->gone, 0, (size_t)e->tet_count);
    if (e->at_m) memcpy(e->at_m, request->u_m, bytes);
    if (e->has_law) memcpy(e->looked_m, request->u_m, bytes);
    e->age = 0;
    e->definite = false;
    bool good = factorise_base(e);
    if (!good && e->has_law) {
        e->definite = true;
        good = factorise_base(e);
    }
    for (int32_t v = 0; v < e->vertex_count; v++) e->slot_of[v] = -1;
    for (int32_t i = 0; i < TMS_SLOTS; i++) e->slot[i] = (tms_slot){.vertex = -1};
    e->touched_count = 0;
    e->frame = request->frame;
    e->middle_known = true;
    e->ready = good;
    return good;
}

/* --- columns --- */

_Static_assert((int)TMS_SLOTS >= TMS_RESULT_VERTICES + TMS_TOUCHED_VERTICES + TMS_BLOCK / 3,
               "whatever is wanted now, there is a slot for a block of others");

/* Assigns a slot to a vertex: a free one, or the least recently requested. */
static int32_t claim(tms_engine *e, int32_t vertex) {
    int32_t best = -1;
    for (int32_t i = 0; i < TMS_SLOTS; i++)
        if (e->slot[i].wanted_at < e->clock && (best < 0 || e->slot[i].wanted_at < e->slot[best].wanted_at)) best = i;
    if (e->slot[best].vertex >= 0) e->slot_of[e->slot[best].vertex] = -1;
    e->slot[best] = (tms_slot){.vertex = vertex, .wanted_at = e->clock};
    return e->slot_of[vertex] = best;
}

/* Solves the columns of at most TMS_BLOCK/3 vertices without one; prescribed components get zeros. */
static void solve_columns(tms_engine *e, const int32_t *vertex, int32_t count) {
    int32_t slot[TMS_SLOTS], row[WIDTH], unit[TMS_BLOCK], slots = 0;
    for (int32_t i = 0; i < count; i++) claim(e, vertex[i]);
    for (int32_t k = 0; k < TMS_SLOTS; k++)
        if (e->slot[k].vertex >= 0) slot[slots++] = k;
    for (int32_t i = 0; i < 3 * slots; i++) row[i] = e->system.index[3 * e->slot[slot[i / 3]].vertex + i % 3];
    for (int32_t j = 0; j < 3 * count; j++) unit[j] = e->system.index[3 * vertex[j / 3] + j % 3];
    tms_reach_solve(e->reach, e->solver, unit, 3 * count, row, 3 * slots, e->column);
    for (int32_t i = 0; i < 3 * slots; i++)
        for (int32_t j = 0; j < 3 * count; j++) {
            const int64_t a = 3 * slot[i / 3] + i % 3, b = 3 * e->slot_of[vertex[j / 3]] + j % 3;
            e->G[a * WIDTH + b] = e->G[b * WIDTH + a] = e->column[i * 3 * count + j];
        }
}

static void mark(tms_engine *e, const int32_t *vertex, int32_t count) {
    for (int32_t i = 0; i < count; i++)
        if (e->slot_of[vertex[i]] >= 0) e->slot[e->slot_of[vertex[i]]].wanted_at = e->clock;
}

/* Lists the next vertices without a column, most urgent first: all touched ones, then the instruments' in turn.
 * `*urgent`: the first one is needed now. */
static int32_t lacking(const tms_engine *e, const tms_compliance_request *request, int32_t ahead,
                       int32_t vertex[TMS_BLOCK / 3], bool *urgent) {
    int32_t count = 0;
    for (int32_t i = 0; i < e->touched_count && count < TMS_BLOCK / 3; i++)
        if (e->slot_of[e->touched[i]] < 0) vertex[count++] = e->touched[i];
    *urgent = count > 0;
    for (int32_t i = 0; i < TM_COMPLIANCE_REQUEST_MAX && count < TMS_BLOCK / 3; i++)
        for (int t = 0; t < TM_MAX_INSTRUMENTS && count < TMS_BLOCK / 3; t++) {
            const int32_t v = i < request->count[t] ? request->vertex[t][i] : -1;
            bool listed = v < 0 || e->slot_of[v] >= 0;
            for (int32_t k = 0; k < count && !listed; k++) listed = vertex[k] == v;
            if (listed) continue;
            vertex[count++] = v;
            *urgent = *urgent || i < request->needed[t] + ahead;
        }
    return count;
}

static bool has_needed(const tms_engine *e, const tms_compliance_request *request) {
    bool has = true;
    for (int32_t i = 0; i < e->touched_count; i++) has = has && e->slot_of[e->touched[i]] >= 0;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++)
        for (int32_t i = 0; i < request->needed[t]; i++) has = has && e->slot_of[request->vertex[t][i]] >= 0;
    return has;
}

/* --- result --- */

/* Lists the vertices of the result, ascending; returns their number. */
static int32_t list_vertices(const tms_engine *e, const tms_compliance_request *request, bool needed_only,
                             int32_t *vertex) {
    int32_t count = 0, unique = 0;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++)
        for (int32_t i = 0; i < (needed_only ? request->needed : request->count)[t]; i++)
            if (e->slot_of[request->vertex[t][i]] >= 0) vertex[count++] = request->vertex[t][i];
    qsort(vertex, (size_t)count, sizeof *vertex, tms_ascending);
    for (int32_t i = 0; i < count; i++)
        if (i == 0 || vertex[i] != vertex[i - 1]) vertex[unique++] = vertex[i];
    return unique;
}

/* Updates the columns of the requested slot components by the cuts since the factor. */
static bool update_slots(tms_engine *e, const int32_t *wanted, int32_t count, const int32_t *touched) {
    const int32_t t = 3 * e->touched_count;
    int32_t column[3 * TMS_RESULT_VERTICES], columns = 0;
    if (t == 0) return true;
    if (!e->middle_known) {
        if (!tms_engine_cut_stiffness(e) || !tms_update_middle(e->G, WIDTH, touched, t, e->D, e->M, e->pivot))
            return false;
        for (int32_t k = 0; k < TMS_SLOTS; k++) e->slot[k].updated = false;
        e->middle_known = true;
    }
    for (int32_t i = 0; i < count; i++)
        if (!e->slot[wanted[i] / 3].updated) column[columns++] = wanted[i];
    if (columns > 0 && !tms_update_columns(e->G, WIDTH, column, columns, touched, t, e->D, e->M, e->pivot, e->X))
        return false;
    for (int32_t i = 0; i < columns; i++) e->slot[column[i] / 3].updated = true;
    return true;
}

static bool write_result(tms_engine *e, const tms_compliance_request *request, bool needed_only,
                         tms_compliance_result *result) {
    int32_t wanted[3 * TMS_RESULT_VERTICES], touched[MIDDLE];
    const int32_t unique = list_vertices(e, request, needed_only, result->vertex);
    for (int32_t i = 0; i < 3 * unique; i++) wanted[i] = 3 * e->slot_of[result->vertex[i / 3]] + i % 3;
    for (int32_t i = 0; i < 3 * e->touched_count; i++) touched[i] = 3 * e->slot_of[e->touched[i / 3]] + i % 3;
    if (unique == 0 || !update_slots(e, wanted, 3 * unique, touched)) return false;
    result->is = (tm_compliance){.revision = request->revision,
                                 .count = unique,
                                 .vertex = result->vertex,
                                 .C_m_N = result->C_m_N,
                                 .age = e->age};
    for (int32_t i = 0; i < unique && e->at_m; i++)
        tms_vertex_frame(tm_tissue_mesh(e->tissue), request->alive, e->at_m, result->vertex[i], result->frame + 9 * i);
    return tms_update_result(e->G, WIDTH, wanted, 3 * unique, touched, 3 * e->touched_count, e->X, result->C_m_N);
}

static bool has_turned(const tms_engine *e, const tms_compliance_request *request, int32_t vertex) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    double Q[9], R[9], off = 0;
    tms_vertex_frame(mesh, request->alive, e->at_m, vertex, Q);
    tms_vertex_frame(mesh, request->alive, request->u_m, vertex, R);
    for (int k = 0; k < 9; k++) off += (R[k] - Q[k]) * (R[k] - Q[k]);
    return off > TURNED_ON * TURNED_ON;
}

static bool has_moved_on(tms_engine *e, const tms_compliance_request *request) {
    double moved = 0;
    if (e->has_law) return tms_engine_has_aged(e, request);
    if (!e->at_m || request->frame - e->frame < MOVES_ON_AFTER) return false;
    for (int32_t i = 0; i < 3 * e->vertex_count; i++) moved = fmax(moved, fabs(request->u_m[i] - e->at_m[i]));
    if (!(moved > e->moved_on_m)) return false;
    bool turned = false;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++)
        for (int32_t i = 0; i < request->needed[t] && !turned; i++)
            turned = has_turned(e, request, request->vertex[t][i]);
    for (int32_t v = 0; v < e->vertex_count && !turned; v += 1 + e->vertex_count / LOOKED_AT)
        turned = has_turned(e, request, v);
    if (turned) e->age = tms_engine_age(e, request);
    return turned;
}

/* Returns whether to solve these columns now. A thread works ahead; a caller that waits solves only needed ones, with
 * the rest of the block filled by others. */
static bool is_worth_solving(int32_t count, bool urgent, bool needed_only) {
    return urgent || (!needed_only && count == TMS_BLOCK / 3);
}

bool tms_engine_advance(tms_engine *e, const tms_compliance_request *request, bool needed_only,
                        tms_compliance_result *result, bool *more) {
    int32_t vertex[TMS_BLOCK / 3];
    bool urgent;
    *more = false;
    if (e->broken) return false;
    e->clock++;
    if (!e->ready || !tms_engine_follow(e, request->alive) || has_moved_on(e, request)) {
        e->broken = !factorise(e, request);
        *more = !e->broken;
        return false;
    }
    mark(e, e->touched, e->touched_count);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) mark(e, request->vertex[t], request->count[t]);
    const int32_t ahead = needed_only ? 0 : AHEAD;
    const int32_t count = lacking(e, request, ahead, vertex, &urgent);
    if (is_worth_solving(count, urgent, needed_only)) {
        solve_columns(e, vertex, count);
        const int32_t left = lacking(e, request, ahead, vertex, &urgent);
        *more = is_worth_solving(left, urgent, needed_only);
    }
    return (!needed_only || !*more) && has_needed(e, request) && write_result(e, request, needed_only, result);
}
