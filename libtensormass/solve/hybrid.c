/* Construction of the hybrid model. The stage that runs in each substep is in stage_hybrid.c. */
#include "hybrid.h"

#include <math.h>
#include <string.h>

/* Smooths the dynamic part's interface. If tetrahedra are marked by their centres, the interface may zigzag through a
 * layer of cells. It then has twice the vertices of a smooth one, and its cost is quadratic in them. */

enum { ITERATIONS = 4 };         /* the teeth of one layer are filled after two */
static const double WORTH = 0.2; /* of the interface's vertices: a smaller gain does not justify a changed part */

static int32_t count_interface(const tm_mesh *mesh, const uint8_t *alive, uint8_t *part) {
    int32_t count = 0;
    memset(part, 0, (size_t)mesh->vertex_count);
    for (int32_t i = 0; i < 4 * mesh->tet_count; i++) part[mesh->tet[i]] |= alive[i / 4] ? TMS_DYNAMIC : TMS_CONDENSED;
    for (int32_t v = 0; v < mesh->vertex_count; v++) count += part[v] == TMS_INTERFACE;
    return count;
}

/* Adds condensed tetrahedra with two or more faces on the dynamic part to it. Returns their number. */
static int32_t fill(const tm_mesh *mesh, const uint8_t *alive, uint8_t *next) {
    int32_t joined = 0;
    memcpy(next, alive, (size_t)mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        int faces = 0;
        for (int i = 0; i < 4 && !alive[t]; i++) {
            const int32_t other = mesh->tet_neighbour[4 * (int64_t)t + i];
            faces += other >= 0 && alive[other];
        }
        if (faces >= 2) next[t] = 1, joined++;
    }
    return joined;
}

bool tms_hybrid_smooth(const tm_mesh *mesh, uint8_t *alive) {
    const size_t tets = (size_t)mesh->tet_count;
    uint8_t *memory = tms_alloc(2 * tets + (size_t)mesh->vertex_count);
    if (!memory) return false;
    uint8_t *now = memory, *next = memory + tets, *part = memory + 2 * tets;
    const int32_t before = count_interface(mesh, alive, part);
    memcpy(now, alive, tets);
    for (int round = 0; round < ITERATIONS && fill(mesh, now, next) > 0; round++) {
        uint8_t *const other = now;
        now = next;
        next = other;
    }
    const int32_t after = count_interface(mesh, now, part);
    if (after > 0 && after < (1 - WORTH) * before) memcpy(alive, now, tets);
    tms_free(memory);
    return true;
}

tm_hybrid_def tm_hybrid_def_default(void) {
    return (tm_hybrid_def){.cookie = TMS_COOKIE_HYBRID,
                           .size = sizeof(tm_hybrid_def),
                           .problem = tm_solve_def_default(),
                           .max_contact_vertices = 256};
}

/* --- parts --- */

static bool take(tm_hybrid *h, const tm_mesh *mesh) {
    const size_t n = (size_t)mesh->vertex_count,
                 faces = (4 * (size_t)mesh->tet_count + (size_t)mesh->surface_count) / 2;
    h->alive = tms_alloc((size_t)mesh->tet_count);
    h->condensed_tet = tms_alloc((size_t)mesh->tet_count);
    h->vertex_kind = tms_alloc_zeroed(n, 1);
    h->fixed = tms_alloc(3 * n);
    h->value_m = tms_alloc_zeroed(3 * n, 8);
    h->load_N = tms_alloc_zeroed(3 * n, 8);
    h->extra_mass_kg = tms_alloc_zeroed(n, 8);
    h->extra_damping_kg_s = tms_alloc_zeroed(n, 8);
    h->interface_index = tms_alloc(12 * n);
    h->surface_triangle = tms_alloc(12 * faces);
    h->surface_face = tms_alloc(4 * faces);
    h->full_u = tms_alloc_zeroed(3 * n, 8);
    h->full_f = tms_alloc(24 * n);
    return h->alive && h->condensed_tet && h->vertex_kind && h->fixed && h->value_m && h->load_N && h->extra_mass_kg &&
           h->extra_damping_kg_s && h->interface_index && h->surface_triangle && h->surface_face && h->full_u &&
           h->full_f;
}

static tm_status split(tm_hybrid *h, const tm_hybrid_def *def, tm_error *error) {
    const tm_mesh *mesh = h->mesh;
    const uint8_t *whole = tm_tissue_alive(def->problem.tissue);
    int32_t dynamic = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        if (!whole[t])
            return tm_fail(
                error, TM_ERR_ARGUMENT, t,
                "tetrahedron %d of the complete tissue has been removed; make the hybrid model from uncut tissue",
                (int)t);
        h->alive[t] = def->dynamic[t] != 0;
    }
    if (!def->as_marked && !tms_hybrid_smooth(mesh, h->alive))
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the interface; use a coarser mesh");
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        h->condensed_tet[t] = !h->alive[t];
        dynamic += h->alive[t];
        for (int i = 0; i < 4; i++)
            h->vertex_kind[mesh->tet[4 * (int64_t)t + i]] |= h->alive[t] ? TMS_DYNAMIC : TMS_CONDENSED;
    }
    if (dynamic == 0 || dynamic == mesh->tet_count)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "%s tetrahedron is in the dynamic part; choose a region or box with some of them",
                       dynamic ? "every" : "no");
    for (int32_t v = 0; v < mesh->vertex_count; v++) h->interface_count += h->vertex_kind[v] == TMS_INTERFACE ? 3 : 0;
    h->interface = tms_alloc((size_t)(h->interface_count + 1) * sizeof *h->interface);
    if (!h->interface) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the interface; use a coarser mesh");
    h->interface_count = 0;
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++) {
        h->interface_index[d] = -1;
        if (h->vertex_kind[d / 3] != TMS_INTERFACE) continue;
        h->interface_index[d] = h->interface_count;
        h->interface[h->interface_count++] = d;
    }
    if (h->interface_count == 0)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "the dynamic part and the rest share no vertex, so there is no interface; choose a part that touches the rest");
    return TM_OK;
}

/* Sets up the condensed part's problem: interface fixed at 0, loads on its interior. */
static void set_problem(tm_hybrid *h, const tm_hybrid_def *def) {
    for (int32_t d = 0; d < 3 * h->mesh->vertex_count; d++) {
        const bool interface = h->vertex_kind[d / 3] == TMS_INTERFACE, inside = h->vertex_kind[d / 3] == TMS_CONDENSED;
        h->fixed[d] = def->problem.fixed[d] || interface;
        if (inside && def->problem.fixed[d] && def->problem.fixed_value_m)
            h->value_m[d] = def->problem.fixed_value_m[d];
        if (inside && def->problem.load_N) h->load_N[d] = def->problem.load_N[d];
    }
    for (int32_t v = 0; v < h->mesh->vertex_count; v++) {
        if (h->vertex_kind[v] != TMS_INTERFACE) continue;
        h->extra_mass_kg[v] = tm_tissue_mass_kg(h->condensed)[v];
        h->extra_damping_kg_s[v] = tm_tissue_damping_kg_s(h->condensed)[v];
    }
}

/* Only condensed tetrahedra with an interface vertex act on vertices with mass. */
static void find_step(tm_hybrid *h, const tm_tissue *whole) {
    h->step_s = INFINITY;
    for (int32_t t = 0; t < h->mesh->tet_count; t++) {
        bool moves = h->alive[t];
        for (int i = 0; i < 4; i++) moves |= h->vertex_kind[h->mesh->tet[4 * (int64_t)t + i]] == TMS_INTERFACE;
        const double step = moves ? tm_critical_step_element(whole, t) : INFINITY;
        if (step < h->step_s) h->step_s = step, h->step_tet = t;
    }
}

static tm_status condense(tm_hybrid *h, const tm_hybrid_def *def, tm_solve_report *report, tm_error *error) {
    uint8_t *wanted = tms_alloc_zeroed((size_t)h->mesh->vertex_count, 1);
    if (!wanted) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to list the surface; use a coarser mesh");
    const tm_mesh *mesh = h->mesh;
    for (int32_t i = 0; i < 3 * mesh->surface_count; i++)
        if (h->vertex_kind[mesh->surface[i]] == TMS_CONDENSED) wanted[mesh->surface[i]] = 1;
    tm_solve_def problem = def->problem;
    problem.tissue = h->condensed;
    problem.fixed = h->fixed;
    problem.fixed_value_m = h->value_m;
    problem.load_N = h->load_N;
    const tms_request request = {.def = &problem,
                                 .interface = h->interface,
                                 .interface_count = h->interface_count,
                                 .wanted = wanted,
                                 .precision = def->precision,
                                 .file = def->file,
                                 .system = &h->system,
                                 .solver = &h->solver};
    const tm_status status = tms_responses_get(&request, false, &h->responses, report, error);
    tms_free(wanted);
    return status;
}

/* Packs the condensed stiffness, its upper triangle row by row. Makes it exactly symmetric: asymmetry would generate
 * energy. */
static bool pack_schur(tm_hybrid *h) {
    const int64_t n = h->interface_count;
    h->schur = tms_alloc((size_t)(n * (n + 1) / 2) * 8);
    double *at = h->schur;
    for (int64_t i = 0; at && i < n; i++)
        for (int64_t j = i; j < n; j++) *at++ = 0.5 * (h->responses.schur[i * n + j] + h->responses.schur[j * n + i]);
    return h->schur != NULL;
}

static tm_status set_up(tm_hybrid *h, const tm_hybrid_def *def, tm_solve_report *report, tm_error *error) {
    tm_status status = TM_OK;
    h->mesh = tm_tissue_mesh(def->problem.tissue);
    if (!take(h, h->mesh)) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a hybrid model; use a coarser mesh");
    if (status == TM_OK) status = split(h, def, error);
    if (status == TM_OK) status = tms_check_constrained(def->problem.tissue, def->problem.fixed, error);
    if (status != TM_OK) return status;
    status = tms_sub_tissue(def->problem.tissue, h->condensed_tet, &h->condensed, error);
    if (status != TM_OK) return status;
    set_problem(h, def);
    find_step(h, def->problem.tissue);
    status = condense(h, def, report, error);
    if (status != TM_OK) return status;
    for (int32_t i = 0; i < h->responses.kept_count; i++) h->interface_index[h->responses.kept[i]] = i;
    h->work = tms_work_create(h->solver, 1);
    h->push_N = tms_alloc((size_t)(h->interface_count + 1) * 8);
    h->at_m = tms_alloc((size_t)(h->interface_count + 1) * 8);
    h->previous_m = tms_alloc((size_t)(h->interface_count + 1) * 8);
    if (!h->work || !pack_schur(h) || !h->push_N || !h->at_m || !h->previous_m)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a hybrid model; use a coarser mesh");
    status = tms_coupling_create(h->condensed, h->interface, h->interface_count, h->schur, h->responses.interface_N,
                                 &h->coupling, error);
    if (status != TM_OK) return status;
    h->surface.revision = -1;
    h->contact_def = def->contact ? *def->contact : (tm_contact_def){0};
    h->has_contact = def->contact != NULL;
    for (int t = 0; def->contact && t < def->contact->instrument_count && t < TM_MAX_INSTRUMENTS; t++)
        h->instrument[t] = def->contact->instrument[t];
    h->contact_def.instrument = h->instrument;
    if (h->has_contact && !tms_hybrid_build_neighbourhood(h))
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for contact with a hybrid model; use a coarser mesh");
    h->max_contact_vertices = def->max_contact_vertices;
    return TM_OK;
}

static tm_status check(const tm_hybrid_def *def, tm_error *error) {
    tm_status status = tms_check_problem(&def->problem, error);
    if (status == TM_OK) status = tms_check_precision(def->precision, error);
    if (status == TM_OK && (def->max_contact_vertices < 4 || def->max_contact_vertices > 4096))
        status = tm_fail(error, TM_ERR_ARGUMENT, -1, "max_contact_vertices is %d; give 4 to 4096",
                         (int)def->max_contact_vertices);
    return status;
}

tm_status tm_hybrid_create(const tm_hybrid_def *def, tm_hybrid **hybrid, tm_solve_report *report, tm_error *error) {
    TM_REQUIRE_DEF(def, TMS_COOKIE_HYBRID, TM_ERR_ARGUMENT);
    TMS_REQUIRE_PROBLEM(&def->problem);
    TM_REQUIRE(hybrid && def->dynamic, "hybrid or def->dynamic is null", TM_ERR_ARGUMENT);
    const tm_status good = check(def, error);
    if (good != TM_OK) return good;
    tm_solve_report mine = {0};
    tm_hybrid *h = tms_alloc_zeroed(1, sizeof *h);
    const tm_status status = h ? set_up(h, def, &mine, error)
                               : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a hybrid model; use a coarser mesh");
    if (report) *report = mine;
    if (status != TM_OK)
        tm_hybrid_destroy(h);
    else
        *hybrid = h;
    return status;
}

void tm_hybrid_destroy(tm_hybrid *h) {
    if (!h) return;
    tms_contact_solver_destroy(&h->solver_contact);
    tms_contact_reuse_destroy(h);
    tms_coupling_destroy(&h->coupling);
    tms_work_destroy(h->work);
    tms_solver_destroy(h->solver);
    tms_system_destroy(&h->system);
    tms_responses_release(&h->responses);
    tm_tissue_destroy(h->condensed);
    void *arrays[] = {h->alive,
                      h->condensed_tet,
                      h->vertex_kind,
                      h->fixed,
                      h->value_m,
                      h->load_N,
                      h->extra_mass_kg,
                      h->extra_damping_kg_s,
                      h->interface_index,
                      h->interface,
                      h->schur,
                      h->push_N,
                      h->at_m,
                      h->surface_triangle,
                      h->surface_face,
                      h->full_u,
                      h->full_f,
                      h->constraint_mode,
                      h->constraint_mode_vertex,
                      h->saved,
                      h->constraint_mode_single,
                      h->gathered_base_m,
                      h->gathered_m,
                      h->since_m,
                      h->interface_mobility_m_N,
                      h->fixed_dof,
                      h->moving,
                      h->previous_m,
                      h->neighbourhood,
                      h->neighbourhood_by,
                      h->neighbourhood_m};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) tms_free(arrays[i]);
    tms_free(h);
}

int64_t tm_hybrid_bytes(const tm_hybrid *h) {
    TM_REQUIRE(h, "hybrid is null", 0);
    const int64_t n = h->mesh->vertex_count, b = h->interface_count;
    return h->responses.bytes + tms_solver_bytes(h->solver) + tms_system_bytes(&h->system) +
           tm_tissue_bytes(h->condensed) + h->solver_contact.bytes + tms_contact_reuse_bytes(h) + h->coupling.bytes +
           4 * (int64_t)h->responses.kept_count * h->neighbourhood_width + 4 * b * (b + 1) +
           24 * b * h->solver_contact.capacity + 12 * (int64_t)h->coupling.padded * h->solver_contact.capacity +
           200 * n + 2 * (int64_t)h->mesh->tet_count;
}

void tm_hybrid_tissue(const tm_hybrid *h, tm_tissue_def *def) {
    TM_REQUIRE(h && def, "hybrid or def is null", );
    def->alive = h->alive;
    def->condensed = h->condensed_tet;
    def->extra_mass_kg = h->extra_mass_kg;
    def->extra_damping_kg_s = h->extra_damping_kg_s;
}

double tm_hybrid_critical_step(const tm_hybrid *h, int32_t *tet) {
    TM_REQUIRE(h, "hybrid is null", 0);
    if (tet) *tet = h->step_tet;
    return h->step_s;
}
