/* Snapshot of a precomputed model: tools, imposed and grasped vertices, the last solution's rows and forces, friction
 * state (online_friction.c), and the contact solver's state between solves (contact_solver_snapshot.c). The surface's
 * shape is recomputed from them. One walk counts, bounds, writes and reads, so that all four have the same members. */
#include <math.h>
#include <string.h>

#include "contact/row_snapshot.h"
#include "precomputed.h"

/* BOUND counts with maximum sizes. */
typedef enum way { COUNT, BOUND, WRITE, READ } way;

typedef struct stream {
    way way;
    char *at; /* all items are multiples of 8 bytes */
    int64_t left, bytes;
    bool bad; /* invalid input: reading stops */
} stream;

static bool room(stream *s, size_t bytes) {
    s->bytes += (int64_t)bytes;
    s->left -= (int64_t)bytes;
    s->bad |= s->way == READ && s->left < 0;
    return s->way != COUNT && s->way != BOUND && !s->bad;
}

static void pass(stream *s, void *value, size_t bytes) {
    if (!room(s, bytes)) return;
    memcpy(s->way == WRITE ? s->at : value, s->way == WRITE ? value : s->at, bytes);
    s->at += bytes;
}

static void pass_numbers(stream *s, double *number, int64_t count) {
    if (s->way == COUNT || s->way == BOUND) {
        room(s, sizeof(double) * (size_t)count);
        return;
    }
    for (int64_t i = 0; i < count; i++) {
        double value = number[i];
        pass(s, &value, sizeof value);
        s->bad |= s->way == READ && !isfinite(value);
        if (s->way == READ && !s->bad) number[i] = value;
    }
}

static void pass_int(stream *s, int32_t *number, int32_t least, int32_t most) {
    int64_t value = *number;
    pass(s, &value, sizeof value);
    s->bad |= s->way == READ && (value < least || value > most);
    if (s->way == READ && !s->bad) *number = (int32_t)value;
}

/* Passes a count; returns the number of items to process. */
static int32_t pass_count(stream *s, int32_t *count, int32_t least, int32_t most) {
    pass_int(s, count, least, most);
    return s->way == BOUND ? most : *count;
}

static void pass_bool(stream *s, bool *flag) {
    int32_t value = *flag;
    pass_int(s, &value, 0, 1);
    *flag = value != 0;
}

/* --- parts --- */

static void pass_tool(stream *s, tms_contact_solver *l, int32_t t) {
    tm_tool_pose pose = l->tool[t].pose;
    tms_grasp *h = &l->grasp_of[t];
    int32_t state = (int32_t)h->state;
    pass_numbers(s, pose.tip_m, 3);
    if (l->tool[t].def.is_free) pass_numbers(s, pose.direction, 3);
    pass_numbers(s, &pose.roll_rad, 1);
    pass_numbers(s, &pose.grip, 1);
    pass_bool(s, &pose.active);
    if (s->way == READ) tms_contact_solver_move(l, t, &pose);
    pass_numbers(s, h->jaw.origin, 3);
    pass_numbers(s, h->jaw.axis_m[0], 9);
    pass_numbers(s, &h->fade, 1);
    pass_int(s, &state, TM_GRASP_OPEN, TM_GRASP_RELEASING);
    h->state = (tm_grasp_state)state;
    pass_bool(s, &h->was_closed);
    const int32_t count = pass_count(s, &h->count, 0, l->grasp.max_vertices);
    for (int32_t i = 0; i < count; i++) pass_int(s, &h->vertex[i], 0, l->mesh->vertex_count - 1);
    pass_numbers(s, h->offset_m, 3 * (int64_t)count);
    pass_numbers(s, h->let_go_N, 3 * (int64_t)count);
}

static void pass_local(stream *s, tms_contact_solver *l) {
    int64_t bytes = s->way == READ    ? 0
                    : s->way == BOUND ? tms_contact_solver_snapshot_max(l)
                                      : tms_contact_solver_snapshot(l, false, NULL);
    pass(s, &bytes, sizeof bytes);
    if (s->way == READ) s->bad = s->bad || bytes < 0 || bytes > s->left;
    if (!room(s, (size_t)bytes)) return;
    if (s->way == WRITE)
        tms_contact_solver_snapshot(l, false, s->at);
    else
        s->bad |= !tms_contact_solver_restore(l, s->at, bytes, true);
    s->at += bytes;
}

static void pass_pins(stream *s, tms_contact_solver *l) {
    pass_int(s, &l->imposed_count, 0, l->capacity);
    const int32_t count = pass_count(s, &l->pin_count, l->imposed_count, l->capacity);
    for (int32_t i = 0; i < count; i++) {
        tms_pin *pin = &l->pin[i];
        pass_int(s, &pin->vertex, 0, l->mesh->vertex_count - 1);
        pass_int(s, &pin->tool, -1, l->tool_count - 1);
        pass_numbers(s, pin->u_m, 3);
        pass_numbers(s, &pin->compliance_m_N, 1);
        pass_numbers(s, &pin->max_N, 1);
        pass_numbers(s, pin->force_N, 3);
        pass_numbers(s, &pin->rotation_N_m, 1);
        pass_bool(s, &pin->fades);
        pass_bool(s, &pin->prescribed);
        if (s->way == READ && !s->bad && l->slot_of[pin->vertex] >= 0) l->pin_of[l->slot_of[pin->vertex]] = i;
    }
}

/* All vertices of a row have slots, as in each solution. */
static void pass_row(stream *s, const tms_contact_solver *l, tm_contact_row *row) {
    tm_packed_row r = s->way == READ ? (tm_packed_row){0} : tm_row_pack(row);
    pass_numbers(s, &r.share, offsetof(tm_packed_row, face) / sizeof(double));
    pass_int(s, &r.face, 0, 4 * l->mesh->tet_count - 1);
    for (int j = 0; j < 3; j++) {
        pass_int(s, &r.vertex[j], 0, l->mesh->vertex_count - 1);
        s->bad |= s->way == READ && l->slot_of[r.vertex[j]] < 0;
    }
    pass_int(s, &r.instrument, 0, l->tool_count - 1);
    pass_int(s, &r.station, 0, 255);
    pass_int(s, &r.feature, 0, 6);
    s->bad |= s->way == READ && !(r.share > 0 && r.share <= 1);
    if (s->way == READ && !s->bad) *row = tm_row_unpack(&r);
}

static void pass_solution(stream *s, tms_contact_solver *l) {
    pass_bool(s, &l->converged);
    const int32_t count = pass_count(s, &l->now.count, 0, l->def.max_rows);
    for (int32_t i = 0; i < count && !s->bad; i++) pass_row(s, l, &l->now.row[i]);
    pass_numbers(s, l->now.fc, 3 * (int64_t)(s->way == BOUND ? l->capacity : l->high));
    for (int32_t t = 0; t < l->tool_count; t++) {
        pass_numbers(s, l->now.force_N[t], 3);
        pass_numbers(s, l->now.resultant_N[t], 3);
        pass_bool(s, &l->now.capped[t]);
    }
}

/* Passes friction in the last solution, of rows that were read before it. */
static void pass_grips(stream *s, tms_contact_eval *look, int32_t max_rows) {
    const int32_t count = pass_count(s, &look->station_count, 0, s->way == BOUND ? max_rows : look->count);
    for (int32_t k = 0; k < count && !s->bad; k++) {
        tms_friction_station *g = &look->station[k];
        pass_int(s, &g->first, 0, look->count - 1);
        pass_int(s, &g->count, 1, look->count - g->first);
        pass_bool(s, &g->slips);
        pass_numbers(s, &g->load_N, 1);
        pass_numbers(s, &g->normal_force_N, 1);
        pass_numbers(s, g->normal, 3);
        pass_numbers(s, g->force_N, 3);
        pass_numbers(s, &g->stretch_N, 1);
    }
}

/* Passes the reference positions of travel, by ascending vertex. */
static void pass_known(stream *s, tms_friction *friction, int32_t vertex_count) {
    int32_t count = 0, v = -1;
    for (int32_t i = 0; i < vertex_count; i++)
        count += friction->known_solution[i] == friction->solution || s->way == BOUND;
    pass_int(s, &count, 0, vertex_count);
    if (s->way == READ) friction->solution++; /* none is known */
    for (int32_t i = 0; i < count && !s->bad; i++) {
        v++;
        while (s->way != READ && s->way != BOUND && friction->known_solution[v] != friction->solution) v++;
        pass_int(s, &v, v, vertex_count - 1);
        if (s->bad) return;
        pass_numbers(s, friction->u_m + 3 * (int64_t)v, 3);
        if (s->way == READ) friction->known_solution[v] = friction->solution;
    }
}

static void pass_friction(stream *s, tms_contact_solver *l) {
    tms_friction *friction = l->friction;
    for (int32_t t = 0; t < l->tool_count; t++) {
        for (int32_t k = 0; k < TMS_STATIONS; k++) {
            tms_friction_state *was = &friction->state[t][k];
            pass_numbers(s, was->force_N, 3);
            pass_numbers(s, &was->stick_state, 1);
            s->bad |= s->way == READ && !(was->stick_state >= 0 && was->stick_state <= 1);
        }
        pass_numbers(s, friction->capsule[t].tip_m, 3);
        pass_numbers(s, friction->capsule[t].tail_m, 3);
    }
    pass_grips(s, &l->now, l->def.max_rows);
    if (!s->bad) pass_known(s, friction, l->mesh->vertex_count);
}

/* Hashes the responses, the capacity of contact, and whether there is friction. */
static uint64_t key_of(const tm_precomputed *m) {
    const tms_responses *r = &m->responses;
    const tms_contact_solver *l = &m->solver;
    const int32_t size[] = {l->tool_count,         l->capacity,           l->def.max_rows,
                            l->grasp.max_vertices, (int32_t)r->precision, l->friction != NULL};
    uint64_t key = tm_hash(r->kept, sizeof *r->kept * (size_t)r->kept_count, TM_HASH_SEED);
    key = tm_hash(r->base_m, sizeof *r->base_m * (size_t)r->kept_count, key);
    return tm_hash(size, sizeof size, key);
}

static void walk(stream *s, tm_precomputed *m) {
    const uint64_t mine = key_of(m);
    uint64_t key = mine;
    pass(s, &key, sizeof key);
    s->bad |= key != mine;
    for (int32_t t = 0; t < m->solver.tool_count && !s->bad; t++) pass_tool(s, &m->solver, t);
    pass_local(s, &m->solver);
    if (!s->bad) pass_pins(s, &m->solver);
    if (!s->bad) pass_solution(s, &m->solver);
    if (!s->bad && m->solver.friction) pass_friction(s, &m->solver);
}

int64_t tms_precomputed_snapshot(const tm_precomputed *model, void *buffer) {
    stream s = {.way = buffer ? WRITE : COUNT, .at = buffer};
    walk(&s, (tm_precomputed *)(uintptr_t)model); /* only reading changes the model */
    return s.bytes;
}

int64_t tms_precomputed_snapshot_max(const tm_precomputed *model) {
    stream s = {.way = BOUND};
    walk(&s, (tm_precomputed *)(uintptr_t)model);
    return s.bytes;
}

static bool read_from(tm_precomputed *m, const void *buffer, int64_t bytes) {
    stream s = {.way = READ, .at = (char *)(uintptr_t)buffer, .left = bytes};
    walk(&s, m);
    m->superposed = false;
    return !s.bad && s.left == 0;
}

tm_status tms_precomputed_restore(tm_precomputed *m, const void *buffer, int64_t bytes, tm_error *error) {
    const int64_t own_bytes = tms_precomputed_snapshot(m, NULL);
    void *own = tms_alloc((size_t)own_bytes);
    if (!own) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to check a snapshot; use a coarser mesh");
    tms_precomputed_snapshot(m, own);
    const bool good = read_from(m, buffer, bytes);
    if (!good) read_from(m, own, own_bytes);
    tms_free(own);
    return good ? TM_OK
                : tm_fail(
                      error, TM_ERR_ARGUMENT, -1,
                      "this is not a snapshot of this precomputed model, or it is damaged; give one of the same organ, "
                      "supports and instruments");
}
