/* Memory of the online contact solver: its vertices, the neighbourhood of its tools, and the compliances among the
 * vertices. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

static const double GATHER_TRAVEL = 0.2; /* radii, of a tool, */
static const double GATHER_WANDER = 0.5; /* and of the tissue itself */

/* --- memory --- */

static void *carve(char **at, size_t bytes) {
    void *p = *at;
    *at = (char *)((uintptr_t)*at +
                   (bytes + 63) / 64 * 64); /* as a number: during measuring there is no memory to point into */
    return p;
}

/* Lays out one block; called with null first, to measure. */
static size_t lay_out(tms_contact_solver *l, char *memory) {
    char *at = memory;
    const size_t n = (size_t)l->mesh->vertex_count, c = (size_t)l->capacity, c3 = 3 * c, rows = (size_t)l->def.max_rows;
    l->base_m = carve(&at, 24 * n);
    l->u_m = carve(&at, 24 * n);
    l->slot_of = carve(&at, 4 * n);
    l->stamp = carve(&at, 4 * n);
    l->vertex = carve(&at, 4 * c);
    l->used = carve(&at, 4 * c);
    l->list = carve(&at, 4 * c);
    l->active = carve(&at, 4 * c);
    l->active_of = carve(&at, 4 * c);
    l->pin_of = carve(&at, 4 * c);
    l->pivot = carve(&at, 4 * c3);
    l->wanted = carve(&at, c);
    l->pin = carve(&at, c * sizeof *l->pin);
    double **vector[] = {&l->f,  &l->f_saved, &l->f_spare, &l->r,       &l->f_kept,
                         &l->du, &l->step,    &l->now.fc,  &l->probe.fc};
    for (size_t i = 0; i < sizeof vector / sizeof *vector; i++) *vector[i] = carve(&at, 8 * c3);
    for (int i = 0; i <= TMS_KRYLOV; i++) l->krylov[i] = carve(&at, 8 * c3);
    for (int i = 0; i < TMS_KRYLOV; i++) l->preconditioned[i] = carve(&at, 8 * c3);
    for (int i = 0; i < TMS_PAIRS; i++) l->pair_f[i] = carve(&at, 8 * c3), l->pair_r[i] = carve(&at, 8 * c3);
    l->block = carve(&at, 8 * c3 * c3);
    l->lu = carve(&at, 8 * c3 * c3);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) {
        const size_t held = (size_t)l->grasp.max_vertices;
        l->grasp_of[t].vertex = carve(&at, 4 * held);
        l->grasp_of[t].offset_m = carve(&at, 24 * held);
        l->grasp_of[t].let_go_N = carve(&at, 24 * held);
        l->grasp_of[t].distance_m = carve(&at, 8 * held);
    }
    tm_contact_row **row[] = {&l->now.row, &l->probe.row, &l->previous};
    for (int i = 0; i < 3; i++) *row[i] = carve(&at, rows * sizeof(tm_contact_row));
    return (size_t)(at - memory);
}

static tm_status check(const tm_contact_def *def, tm_error *error) {
    if (def->instrument_count < 0 || def->instrument_count > TM_MAX_INSTRUMENTS)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "contact has %d instruments; give at most %d",
                       (int)def->instrument_count, TM_MAX_INSTRUMENTS);
    if (!(def->contact_compliance_m_N >= 1e-7))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "contact compliance is %g m/N; the quasi-static models need at least 1e-7 (0.5e-3 is usual)",
                       def->contact_compliance_m_N);
    if (def->max_rows < 1 || !(def->force_cap_N > 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "contact has %d rows and a force cap of %g N; give at least one row and a positive cap",
                       (int)def->max_rows, def->force_cap_N);
    for (int32_t t = 0; t < def->instrument_count; t++)
        if (!(def->instrument[t].radius_m > 0) || !(def->instrument[t].contact_length_m >= 0))
            return tm_fail(
                error, TM_ERR_ARGUMENT, t,
                "instrument %d has radius %g m and contact length %g m; give a positive radius and a length of 0 or more",
                (int)t, def->instrument[t].radius_m, def->instrument[t].contact_length_m);
    return TM_OK;
}

tm_status tms_contact_solver_create(const tm_mesh *mesh, tm_surface_view surface, const tm_contact_def *contact,
                                    const tm_grasp_def *grasp, int32_t capacity, tms_contact_solver *solver,
                                    tm_error *error) {
    tms_contact_solver l = {.mesh = mesh,
                            .surface = surface,
                            .capacity = capacity,
                            .gather_every = TMS_GATHER_EVERY,
                            .def = contact ? *contact : tm_contact_def_default()};
    l.converged = true; /* no solve yet */
    if (!contact) l.def.instrument_count = 0;
    if (grasp) l.grasp = *grasp;
    if (capacity < 4 || capacity > 4096)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "max_contact_vertices is %d; give 4 to 4096", (int)capacity);
    const tm_status status = check(&l.def, error);
    if (status != TM_OK) return status;
    l.tool_count = l.def.instrument_count;
    l.bytes = (int64_t)lay_out(&l, NULL);
    l.allocation = tms_alloc((size_t)l.bytes);
    if (!l.allocation)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for %d contact vertices; lower max_contact_vertices",
                       (int)capacity);
    memset(l.allocation, 0, (size_t)l.bytes);
    lay_out(&l, l.allocation);
    for (int32_t v = 0; v < mesh->vertex_count; v++) l.slot_of[v] = -1;
    for (int32_t s = 0; s < capacity; s++) l.vertex[s] = l.pin_of[s] = l.active_of[s] = -1;
    *solver = l;
    solver->def.instrument = NULL; /* the caller's array is copied */
    tms_contact_solver_regather(solver);
    for (int32_t t = 0; t < l.tool_count; t++) {
        solver->tool[t].def = l.def.instrument[t];
        tms_contact_solver_set_pose(solver, t, &l.def.instrument[t].pose);
        tm_jaw_begin(&solver->grasp_of[t].jaw, &solver->tool[t].def, &solver->tool[t].pose);
        const tm_status made = tm_contact_search_create(&solver->tool[t].search, error);
        if (made == TM_OK) continue;
        tms_contact_solver_destroy(solver);
        return made;
    }
    return TM_OK;
}

void tms_contact_solver_destroy(tms_contact_solver *solver) {
    for (int32_t t = 0; t < solver->tool_count; t++) tm_contact_search_destroy(solver->tool[t].search);
    tms_free(solver->allocation);
    *solver = (tms_contact_solver){0};
}

bool tms_contact_solver_can_touch(const tms_tool *tool) {
    return tool->pose.active || tool->def.mode == TM_TOOL_CAUTERY;
}

/* --- selection of vertices --- */

static int32_t want(tms_contact_solver *l, int32_t v, int32_t count) {
    if (l->stamp[v] == l->stamp_now || count < 0) return count;
    if (count == l->capacity) return -1;
    l->stamp[v] = l->stamp_now;
    int32_t at = count;
    for (; at > 0 && l->list[at - 1] > v; at--) l->list[at] = l->list[at - 1];
    l->list[at] = v;
    return count + 1;
}

/* Lists the vertices needed now; returns -1 if there are too many. */
static int32_t list_wanted(tms_contact_solver *l) {
    int32_t count = 0;
    l->stamp_now++;
    for (int32_t i = 0; i < l->pin_count; i++) count = want(l, l->pin[i].vertex, count);
    for (int32_t t = 0; t < l->tool_count; t++) {
        const int32_t *vertex, vertices = l->tool[t].near ? tm_contact_search_vertices(l->tool[t].search, &vertex) : 0;
        for (int32_t i = 0; i < vertices; i++) count = want(l, vertex[i], count);
    }
    return count;
}

/* Always requested with the lower vertex first: rounding must not depend on the order of vertices. */
static void block_of(const tms_contact_solver *l, int32_t a, int32_t b, double C[9]) {
    if (a <= b) {
        l->compliance(l->self, a, b, C);
        return;
    }
    double other[9];
    l->compliance(l->self, b, a, other);
    for (int i = 0; i < 9; i++) C[i] = other[3 * (i % 3) + i / 3];
}

void tms_contact_solver_fill(tms_contact_solver *l, int32_t slot, int32_t vertex) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    l->vertex[slot] = vertex;
    l->slot_of[vertex] = slot;
    if (slot >= l->high) l->high = slot + 1;
    for (int32_t other = 0; other < l->high; other++) {
        if (l->vertex[other] < 0) continue;
        double C[9];
        block_of(l, vertex, l->vertex[other], C);
        for (int i = 0; i < 9; i++) {
            l->block[(3 * slot + i / 3) * c3 + 3 * other + i % 3] = C[i];
            l->block[(3 * other + i % 3) * c3 + 3 * slot + i / 3] = C[i];
        }
    }
}

/* Assigns a slot to each listed vertex; existing ones keep it and its compliances. */
static void assign_slots(tms_contact_solver *l, int32_t count) {
    int32_t next = 0;
    memset(l->wanted, 0, (size_t)l->capacity);
    for (int32_t i = 0; i < count; i++)
        if (l->slot_of[l->list[i]] >= 0) l->wanted[l->slot_of[l->list[i]]] = 1;
    for (int32_t s = 0; s < l->capacity; s++) {
        if (l->wanted[s]) continue;
        for (int c = 0; c < 3; c++) l->f[3 * s + c] = 0; /* out of reach: no force */
        l->pin_of[s] = -1;
    }
    for (int32_t i = 0; i < count; i++) {
        const int32_t v = l->list[i];
        if (l->slot_of[v] < 0) {
            while (l->wanted[next]) next++;
            if (l->vertex[next] >= 0) l->slot_of[l->vertex[next]] = -1;
            l->wanted[next] = 1;
            tms_contact_solver_fill(l, next, v);
            l->pair_count = 0; /* they were of another vertex here */
        }
        l->used[i] = l->slot_of[v];
        l->pin_of[l->slot_of[v]] = -1;
    }
    l->used_count = count;
    for (int32_t i = 0; i < l->pin_count; i++) l->pin_of[l->slot_of[l->pin[i].vertex]] = i;
}

void tms_contact_solver_forget(tms_contact_solver *l) {
    for (int32_t s = 0; s < l->capacity; s++) {
        if (l->vertex[s] >= 0) l->slot_of[l->vertex[s]] = -1;
        l->vertex[s] = l->pin_of[s] = -1;
    }
    l->used_count = l->pair_count = l->high = 0;
    tms_contact_solver_regather(l);
    memset(l->f, 0, 24 * (size_t)l->capacity);
}

void tms_contact_solver_regather(tms_contact_solver *l) {
    l->used_count = 0;
    l->gathered_age = l->gather_every;
}

bool tms_contact_solver_has_wandered(const tms_contact_solver *l) {
    bool far = false;
    for (int32_t t = 0; t < l->tool_count; t++)
        far |= l->tool[t].near && l->wandered_m > GATHER_WANDER * l->tool[t].def.radius_m;
    return far;
}

static bool still_around(tms_contact_solver *l) {
    double most = 0;
    if (tms_contact_solver_has_wandered(l)) return false;
    for (int32_t t = 0; t < l->tool_count; t++)
        for (int c = 0; c < 3; c++) {
            const tms_tool *tool = &l->tool[t];
            if (tool->near != tms_contact_solver_can_touch(tool)) return false;
            most = fmax(most, fabs(tool->capsule.tip_m[c] - tool->gathered_at.tip_m[c]) / tool->def.radius_m);
            most = fmax(most, fabs(tool->capsule.tail_m[c] - tool->gathered_at.tail_m[c]) / tool->def.radius_m);
        }
    return l->gathered_age++ < l->gather_every && most < GATHER_TRAVEL;
}

void tms_contact_solver_gather(tms_contact_solver *l) {
    if (still_around(l)) {
        if (l->refresh) l->refresh(l->self, l->list, l->used_count);
        return;
    }
    l->gathered_age = 1;
    l->wandered_m = 0;
    if (l->update_neighbourhood) l->update_neighbourhood(l->self);
    double reach = 2.5; /* radii: reach of detection, an increment of the path, and motion of the tissue */
    int32_t count = -1;
    for (int tries = 0; count < 0; tries++, reach *= 0.8) {
        for (int32_t t = 0; t < l->tool_count; t++) {
            tms_tool *tool = &l->tool[t];
            const int32_t *vertex;
            tool->near = tms_contact_solver_can_touch(tool) && tries < 20; /* without capacity for any */
            tool->gathered_at = tool->capsule;
            if (!tool->near) continue;
            tool->overflowed = !tm_contact_search_gather(tool->search, l->mesh->rest_m, l->u_m, &l->surface,
                                                         &tool->capsule, reach * tool->def.radius_m) ||
                               tries > 2;
            tool->near = tm_contact_search_vertices(tool->search, &vertex) > 0;
        }
        count = list_wanted(l);
    }
    assign_slots(l, count);
    if (l->refresh) l->refresh(l->self, l->list, count);
}

/* --- tools --- */

void tms_contact_solver_move(tms_contact_solver *l, int32_t t, const tm_tool_pose *pose) {
    l->tool[t].pose = *pose;
    l->tool[t].capsule = tm_tool_capsule(&l->tool[t].def, pose, t);
}

void tms_contact_solver_set_pose(tms_contact_solver *l, int32_t t, const tm_tool_pose *at) {
    tms_contact_solver_move(l, t, at);
    int32_t kept = 0; /* its old penetration was elsewhere */
    for (int32_t i = 0; i < l->previous_count; i++)
        if (l->previous[i].instrument != t) l->previous[kept++] = l->previous[i];
    l->previous_count = kept;
}
