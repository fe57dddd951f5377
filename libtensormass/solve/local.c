/* The on-line system: which vertices are in it, rows and forces of a shape, the path of the tools. Newton's method is in newton.c. */
#include "local.h"
#include "local_eval.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* --- memory --- */

static void *carve(char **at, size_t bytes) {
    void *p = *at;
    *at += (bytes + 63) / 64 * 64;
    return p;
}

/* One block; called with null first, to measure. */
static size_t lay_out(tms_local *l, char *memory, int32_t tools) {
    char *at = memory;
    const size_t n = (size_t)l->mesh->vertex_count, c = (size_t)l->capacity, c3 = 3 * c, rows = (size_t)l->def.max_rows;
    l->base_m = carve(&at, 24 * n);
    l->u_m = carve(&at, 24 * n);
    l->slot_of = carve(&at, 4 * n);
    l->stamp = carve(&at, 4 * n);
    l->vertex = carve(&at, 4 * c);
    l->use = carve(&at, 4 * c);
    l->list = carve(&at, 4 * c);
    l->act = carve(&at, 4 * c);
    l->act_of = carve(&at, 4 * c);
    l->pin_of = carve(&at, 4 * c);
    l->pivot = carve(&at, 4 * c3);
    l->wanted = carve(&at, c);
    l->pin = carve(&at, c * sizeof *l->pin);
    double **vector[] = {&l->f, &l->fc, &l->r, &l->step, &l->keep, &l->try_u, &l->rhs};
    for (size_t i = 0; i < sizeof vector / sizeof *vector; i++) *vector[i] = carve(&at, 8 * c3);
    l->block = carve(&at, 8 * c3 * c3);
    l->lu = carve(&at, 8 * c3 * c3);
    l->row = carve(&at, rows * sizeof *l->row);
    l->before = carve(&at, rows * sizeof *l->before);
    for (int32_t t = 0; t < tools; t++) l->tool[t].candidate = carve(&at, 4 * (size_t)l->surface.count);
    return (size_t)(at - memory);
}

static tm_status check(const tm_contact_def *def, tm_error *error) {
    if (def->instrument_count < 0 || def->instrument_count > TM_MAX_INSTRUMENTS)
        return tms_fail(error, TM_ERR_ARGUMENT, -1, "contact: %d instruments; give at most %d", (int)def->instrument_count, TM_MAX_INSTRUMENTS);
    if (!(def->skin_compliance_m_N >= 1e-7))
        return tms_fail(error, TM_ERR_ARGUMENT, -1, "contact: skin compliance %g m/N; the quasi-static models need at least 1e-7 (0.5e-3 is usual)", def->skin_compliance_m_N);
    if (def->max_rows < 1 || !(def->force_cap_N > 0))
        return tms_fail(error, TM_ERR_ARGUMENT, -1, "contact: %d rows and a cap of %g N; give at least one row and a positive cap", (int)def->max_rows, def->force_cap_N);
    for (int32_t t = 0; t < def->instrument_count; t++)
        if (!(def->instrument[t].radius_m > 0) || !(def->instrument[t].contact_length_m >= 0))
            return tms_fail(error, TM_ERR_ARGUMENT, t, "instrument %d: radius %g m, contact length %g m; give a positive radius and a length of 0 or more", (int)t, def->instrument[t].radius_m, def->instrument[t].contact_length_m);
    return TM_OK;
}

tm_status tms_local_create(const tm_mesh *mesh, tm_surface_view surface, const tm_contact_def *contact, int32_t capacity, tms_local *local,
                           tm_error *error) {
    tms_local l = {.mesh = mesh, .surface = surface, .capacity = capacity, .def = contact ? *contact : tm_contact_def_default()};
    if (!contact) l.def.instrument_count = 0;
    if (capacity < 4 || capacity > 4096) return tms_fail(error, TM_ERR_ARGUMENT, -1, "room for %d vertices on line; give 4 to 4096", (int)capacity);
    const tm_status status = check(&l.def, error);
    if (status != TM_OK) return status;
    l.tool_count = l.def.instrument_count;
    l.bytes = (int64_t)lay_out(&l, NULL, l.tool_count);
    l.memory = aligned_alloc(64, (size_t)l.bytes);
    if (!l.memory) return tms_fail(error, TM_ERR_MEMORY, -1, "no memory for %d vertices on line; lower max_local_vertices", (int)capacity);
    memset(l.memory, 0, (size_t)l.bytes);
    lay_out(&l, l.memory, l.tool_count);
    for (int32_t v = 0; v < mesh->vertex_count; v++) l.slot_of[v] = -1;
    for (int32_t s = 0; s < capacity; s++) l.vertex[s] = l.pin_of[s] = l.act_of[s] = -1;
    *local = l;
    for (int32_t t = 0; t < l.tool_count; t++) {
        local->tool[t].def = l.def.instrument[t];
        tms_local_place(local, t, &l.def.instrument[t].pose);
    }
    local->def.instrument = NULL;
    return TM_OK;
}

void tms_local_destroy(tms_local *local) {
    free(local->memory);
    *local = (tms_local){0};
}

/* --- which vertices --- */

static double axis_distance(const tm_capsule *c, const double p[3]) {
    double axis[3], to[3], along = 0, length2 = 0, sum = 0;
    for (int i = 0; i < 3; i++) axis[i] = c->tail_m[i] - c->tip_m[i], to[i] = p[i] - c->tip_m[i];
    for (int i = 0; i < 3; i++) along += axis[i] * to[i], length2 += axis[i] * axis[i];
    const double t = length2 > 0 ? fmin(fmax(along / length2, 0), 1) : 0;
    for (int i = 0; i < 3; i++) sum += (to[i] - t * axis[i]) * (to[i] - t * axis[i]);
    return sqrt(sum);
}

/* Triangles whose bounding ball comes within `reach` of the axis. */
static void find_candidates(const tms_local *l, tms_tool *tool, double reach) {
    tool->candidate_count = 0;
    if (!tool->pose.active) return;
    for (int32_t i = 0; i < l->surface.count; i++) {
        const int32_t *v = l->surface.triangle + 3 * (int64_t)i;
        double p[3][3], centre[3] = {0}, far2 = 0;
        for (int k = 0; k < 3; k++)
            for (int c = 0; c < 3; c++) {
                p[k][c] = l->mesh->rest_m[3 * (int64_t)v[k] + c] + l->u_m[3 * (int64_t)v[k] + c];
                centre[c] += p[k][c] / 3;
            }
        for (int k = 0; k < 3; k++) {
            double d2 = 0;
            for (int c = 0; c < 3; c++) d2 += (p[k][c] - centre[c]) * (p[k][c] - centre[c]);
            far2 = fmax(far2, d2);
        }
        if (axis_distance(&tool->capsule, centre) <= reach + sqrt(far2)) tool->candidate[tool->candidate_count++] = i;
    }
}

static int32_t want(tms_local *l, int32_t v, int32_t count) {
    if (l->stamp[v] == l->stamp_now || count < 0) return count;
    if (count == l->capacity) return -1;
    l->stamp[v] = l->stamp_now;
    int32_t at = count;
    for (; at > 0 && l->list[at - 1] > v; at--) l->list[at] = l->list[at - 1];
    l->list[at] = v;
    return count + 1;
}

/* Vertices wanted now into `list`; -1 when they are too many. */
static int32_t list_wanted(tms_local *l) {
    int32_t count = 0;
    l->stamp_now++;
    for (int32_t i = 0; i < l->pin_count; i++) count = want(l, l->pin[i].vertex, count);
    for (int32_t t = 0; t < l->tool_count; t++)
        for (int32_t i = 0; i < l->tool[t].candidate_count; i++)
            for (int k = 0; k < 3; k++) count = want(l, l->surface.triangle[3 * (int64_t)l->tool[t].candidate[i] + k], count);
    return count;
}

static void fill_slot(tms_local *l, int32_t slot) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    for (int32_t other = 0; other < l->capacity; other++) {
        if (l->vertex[other] < 0) continue;
        double C[9];
        l->compliance(l->self, l->vertex[slot], l->vertex[other], C);
        for (int i = 0; i < 9; i++) {
            l->block[(3 * slot + i / 3) * c3 + 3 * other + i % 3] = C[i];
            l->block[(3 * other + i % 3) * c3 + 3 * slot + i / 3] = C[i];
        }
    }
}

/* A slot for every listed vertex: those that have one keep it and its compliances. */
static void assign_slots(tms_local *l, int32_t count) {
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
            l->vertex[next] = v;
            l->slot_of[v] = next;
            l->wanted[next] = 1;
            fill_slot(l, next);
        }
        l->use[i] = l->slot_of[v];
        l->pin_of[l->slot_of[v]] = -1;
    }
    l->use_count = count;
    for (int32_t i = 0; i < l->pin_count; i++) l->pin_of[l->slot_of[l->pin[i].vertex]] = i;
}

void tms_local_gather(tms_local *l) {
    double room = 2; /* radii: a tick's travel and give, and what the finder looks at */
    int32_t count = -1;
    for (int tries = 0; tries < 4 && count < 0; tries++, room *= 0.6) {
        for (int32_t t = 0; t < l->tool_count; t++) {
            find_candidates(l, &l->tool[t], room * l->tool[t].def.radius_m);
            l->tool[t].overflowed = tries > 1;
        }
        count = list_wanted(l);
    }
    for (int32_t t = 0; count < 0 && t < l->tool_count; t++) l->tool[t].overflowed = true;
    while (count < 0) { /* still too many: drop the last candidates until the rest fits */
        for (int32_t t = 0; t < l->tool_count; t++) l->tool[t].candidate_count = l->tool[t].candidate_count * 3 / 4;
        count = list_wanted(l);
    }
    assign_slots(l, count);
    if (l->refresh) l->refresh(l->self, l->list, count);
}

/* --- rows and forces --- */

void tms_local_shape(tms_local *l) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    for (int32_t i = 0; i < l->use_count; i++) {
        const int32_t a = l->use[i], v = l->vertex[a];
        for (int c = 0; c < 3; c++) {
            const double *row = l->block + (3 * a + c) * c3;
            double sum = 0;
            for (int32_t j = 0; j < l->use_count; j++) {
                const int32_t b = l->use[j];
                sum += row[3 * b] * l->f[3 * b] + row[3 * b + 1] * l->f[3 * b + 1] + row[3 * b + 2] * l->f[3 * b + 2];
            }
            l->u_m[3 * (int64_t)v + c] = l->base_m[3 * (int64_t)v + c] + sum;
        }
    }
}

static void add_row(tms_local *l, tms_tool *tool, tm_contact_row *row) {
    const double press = -row->gap_m * row->share / l->def.skin_compliance_m_N;
    row->lambda_N = press < 0 ? 0 : press > l->def.force_cap_N ? l->def.force_cap_N : press;
    tool->capped |= press > l->def.force_cap_N;
    double on_tool[3], at_tip[3];
    for (int c = 0; c < 3; c++) on_tool[c] = -row->lambda_N * row->normal[c];
    tm_tip_force(tool->def.trocar_m, tool->pose.tip_m, row->point_m, on_tool, at_tip);
    for (int c = 0; c < 3; c++) tool->force_N[c] += at_tip[c], tool->resultant_N[c] += on_tool[c];
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++) l->fc[3 * l->slot_of[row->vertex[k]] + c] -= row->weight[k] * on_tool[c];
}

void tms_local_rows(tms_local *l, tm_contact_row *row, int32_t *row_count) {
    int32_t count = 0, first = 0;
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) l->fc[3 * l->use[i] + c] = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_tool *tool = &l->tool[t];
        int32_t last = first;
        while (last < l->before_count && l->before[last].instrument == t) last++;
        memset(tool->force_N, 0, sizeof tool->force_N);
        memset(tool->resultant_N, 0, sizeof tool->resultant_N);
        tool->row_count = 0;
        tool->capped = false;
        if (!tool->ignored && tool->candidate_count > 0) {
            bool overflowed = false;
            tool->row_count = tm_contact_find_after(l->mesh->rest_m, l->u_m, l->surface.triangle, l->surface.face, tool->candidate, tool->candidate_count,
                                                    &tool->capsule, 0, l->before + first, last - first, row + count, l->def.max_rows - count, &overflowed);
            tool->overflowed |= overflowed;
            for (int32_t i = count; i < count + tool->row_count; i++) add_row(l, tool, &row[i]);
            count += tool->row_count;
        }
        first = last;
    }
    *row_count = count;
}

/* --- tools --- */

static void set_pose(tms_local *l, int32_t t, const tm_tool_pose *pose) {
    l->tool[t].pose = *pose;
    l->tool[t].capsule = tm_tool_capsule(&l->tool[t].def, pose, t);
}

void tms_local_place(tms_local *l, int32_t t, const tm_tool_pose *at) {
    set_pose(l, t, at);
    int32_t kept = 0; /* what it had sunk into was elsewhere */
    for (int32_t i = 0; i < l->before_count; i++)
        if (l->before[i].instrument != t) l->before[kept++] = l->before[i];
    l->before_count = kept;
}

static int32_t pieces_of(const tms_local *l, const tm_tool_pose *pose) {
    double most = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        double d2 = 0;
        const tm_capsule to = tm_tool_capsule(&l->tool[t].def, &pose[t], t), *from = &l->tool[t].capsule;
        for (int c = 0; c < 3; c++) d2 += (to.tip_m[c] - from->tip_m[c]) * (to.tip_m[c] - from->tip_m[c]);
        double tail2 = 0;
        for (int c = 0; c < 3; c++) tail2 += (to.tail_m[c] - from->tail_m[c]) * (to.tail_m[c] - from->tail_m[c]);
        if (pose[t].active || l->tool[t].pose.active) most = fmax(most, sqrt(fmax(d2, tail2)) / (0.5 * l->tool[t].def.radius_m));
    }
    return most <= 1 ? 1 : most >= TMS_MAX_PIECES ? TMS_MAX_PIECES : (int32_t)ceil(most);
}

int32_t tms_local_update(tms_local *l, const tm_tool_pose *pose) {
    const int32_t pieces = l->tool_count ? pieces_of(l, pose) : 1;
    tm_tool_pose from[TM_MAX_INSTRUMENTS];
    int32_t steps = 0;
    for (int32_t t = 0; t < l->tool_count; t++) from[t] = l->tool[t].pose;
    for (int32_t p = 1; p <= pieces; p++) {
        const double s = (double)p / pieces;
        for (int32_t t = 0; t < l->tool_count; t++) {
            tm_tool_pose at = pose[t];
            for (int c = 0; c < 3 && p < pieces; c++) at.tip_m[c] = from[t].tip_m[c] + s * (pose[t].tip_m[c] - from[t].tip_m[c]);
            set_pose(l, t, &at);
        }
        tms_local_gather(l);
        steps = tms_local_solve(l);
    }
    return steps;
}

tm_tool_reaction tms_local_reaction(const tms_local *l, int32_t t) {
    const tms_tool *tool = &l->tool[t];
    tm_tool_reaction r = {.capped = tool->capped, .overflowed = tool->overflowed};
    for (int c = 0; c < 3; c++) r.tip_m[c] = tool->pose.tip_m[c], r.force_N[c] = tool->force_N[c], r.resultant_N[c] = tool->resultant_N[c];
    for (int32_t i = 0; i < l->row_count; i++) r.row_count += l->row[i].instrument == t && l->row[i].lambda_N > 0;
    return r;
}
