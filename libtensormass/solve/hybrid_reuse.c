/* Contact of the hybrid model between full solves, with reused rows.
 *
 * A full solve detects rows several times and couples all vertices around the tools through the complete interface.
 * Condensed tissue is massless, so a tool's rows on it change little per substep. They keep normals and shares for 1 to
 * 32 substeps; only their forces are solved, for the present tool and interface. Rows on dynamic tissue, or on what a
 * cut left of it, are detected in each substep, as in the dynamic model. If one tool touches both kinds, each substep
 * is a full solve.
 *
 * Static contact stays exact: rows of a resting shape and interface keep their forces. The interval adapts until the
 * force jumps by at most 1 % at its end. Jaw motion, a cut, or a tool that leaves its range ends it at once. */
#include "contact_solver.h"
#include "hybrid.h"

#include <math.h>
#include <string.h>

static const double MARGIN = 0.1; /* radii: rows within it may be touched after the tissue's motion */

bool tms_contact_reuse_create(tm_hybrid *h) {
    const size_t n = (size_t)h->interface_count;
    h->reuse = tms_alloc_zeroed(1, sizeof *h->reuse);
    if (!h->reuse) return false;
    h->reuse->gap_gradient = tms_alloc((size_t)TMS_REUSE_ROWS * n * 8 + 8);
    h->reuse->push_N = tms_alloc_zeroed(n + 1, 8);
    for (int32_t t = 0; t < h->mesh->tet_count; t++) h->reuse->whole_count += h->alive[t];
    tms_contact_reuse_forget(h);
    return h->reuse->gap_gradient && h->reuse->push_N;
}

void tms_contact_reuse_destroy(tm_hybrid *h) {
    if (!h->reuse) return;
    tms_free(h->reuse->gap_gradient);
    tms_free(h->reuse->push_N);
    tms_free(h->reuse);
    h->reuse = NULL;
}

int64_t tms_contact_reuse_bytes(const tm_hybrid *h) {
    return h->reuse ? (int64_t)sizeof *h->reuse + 8 * (TMS_REUSE_ROWS + 1) * (int64_t)h->interface_count : 0;
}

void tms_contact_reuse_forget(tm_hybrid *h) {
    h->reuse->age = -1;
    h->reuse->length = 1;
    h->reuse->limit = 1;
    h->reuse->frozen_count = 0;
    memset(h->reuse->predicted_growth, 0, sizeof h->reuse->predicted_growth);
    memset(h->reuse->last_growth, 0, sizeof h->reuse->last_growth);
}

/* --- rows --- */

double tms_contact_reuse_station(const tm_capsule *c, const tm_contact_row *row, double point_m[3]) {
    double axis[3], size = 0, along = 0;
    for (int k = 0; k < 3; k++) axis[k] = c->tail_m[k] - c->tip_m[k], size += axis[k] * axis[k];
    for (int k = 0; k < 3; k++) {
        point_m[k] = c->tip_m[k] + (size > 0 ? row->station * c->radius_m / sqrt(size) * axis[k] : 0);
        along += row->normal[k] * point_m[k];
    }
    return along;
}

/* Computes the derived data of a frozen row, except its offset, from the slots of its vertices. */
static void fill_frozen(tm_hybrid *h, const tm_contact_row *row, int32_t at) {
    const int32_t n = h->interface_count;
    double *out = h->reuse->gap_gradient + (int64_t)at * n;
    memset(out, 0, 8 * (size_t)n);
    for (int a = 0; a < 9; a++) {
        const double G = row->weight[a / 3] * row->normal[a % 3];
        if (G == 0) continue;
        if (h->vertex_kind[row->vertex[a / 3]] == TMS_INTERFACE) {
            out[h->interface_index[3 * row->vertex[a / 3] + a % 3]] += G;
            continue;
        }
        const double *through = tms_hybrid_constraint_mode(h, row->vertex[a / 3]) + (int64_t)(a % 3) * n;
        for (int32_t k = 0; k < n; k++) out[k] += G * through[k];
    }
}

static double delassus_of(const tms_contact_solver *l, const tm_contact_row *row, const tm_contact_row *other) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double sum = 0;
    for (int a = 0; a < 9; a++) {
        const double G = row->weight[a / 3] * row->normal[a % 3];
        const double *C = l->block + (3 * l->slot_of[row->vertex[a / 3]] + a % 3) * c3;
        for (int b = 0; b < 9 && G != 0; b++)
            sum += G * C[3 * l->slot_of[other->vertex[b / 3]] + b % 3] * other->weight[b / 3] * other->normal[b % 3];
    }
    return sum;
}

/* Sums the forces of all rows on the interface. */
static void sum_push(tm_hybrid *h) {
    const tms_contact_solver *l = &h->solver_contact;
    tms_contact_reuse *s = h->reuse;
    const int32_t n = h->interface_count;
    memset(s->push_N, 0, 8 * (size_t)n);
    for (int32_t i = 0; i < l->previous_count; i++) {
        const tm_contact_row *row = &l->previous[i];
        const double *follow = s->frozen[i] < 0 ? NULL : s->gap_gradient + (int64_t)s->frozen[i] * n;
        if (follow && row->lambda_N > 0) tms_add_times(row->lambda_N, follow, n, s->push_N);
        for (int a = 0; a < 9 && s->frozen[i] < 0; a++)
            if (tms_row_is_in(h, row, a / 3, TMS_INTERFACE))
                s->push_N[h->interface_index[3 * row->vertex[a / 3] + a % 3]] +=
                    row->weight[a / 3] * row->normal[a % 3] * row->lambda_N;
    }
}

void tms_contact_reuse_build(tm_hybrid *h) {
    tms_contact_reuse *s = h->reuse;
    const tm_contact_row *row = h->solver_contact.previous;
    const int32_t count = h->solver_contact.previous_count;
    for (int32_t i = 0; i < count; i++) {
        if (s->frozen[i] < 0) continue;
        fill_frozen(h, row + i, s->frozen[i]);
        for (int32_t j = 0; j <= i; j++) {
            if (s->frozen[j] < 0) continue;
            const double give = delassus_of(&h->solver_contact, row + i, row + j);
            s->delassus_m_N[s->frozen[i]][s->frozen[j]] = s->delassus_m_N[s->frozen[j]][s->frozen[i]] = give;
        }
    }
    sum_push(h);
}

/* --- a substep with reused rows --- */

/* Returns whether each tool is within `rooms` times its margin of its old place. */
static bool is_within(const tm_hybrid *h, double rooms) {
    for (int32_t t = 0; t < h->solver_contact.tool_count; t++)
        for (int c = 0; c < 3; c++) {
            const tm_capsule *at = &h->solver_contact.tool[t].capsule;
            const double *was = h->reuse->at_m[t], room = rooms * h->reuse->margin_m[t];
            if (h->reuse->kind[t] != TMS_TOOL_NONE &&
                !(fabs(at->tip_m[c] - was[c]) <= room && fabs(at->tail_m[c] - was[3 + c]) <= room))
                return false;
        }
    return true;
}

bool tms_contact_reuse_is_over(const tm_hybrid *h) {
    return h->reuse->age < 0 || h->reuse->age + 1 >= h->reuse->limit || !is_within(h, 1) ||
           tms_contact_solver_has_wandered(&h->solver_contact);
}

static bool may_follow(const tm_hybrid *h) {
    const tms_contact_solver *l = &h->solver_contact;
    const tms_contact_reuse *s = h->reuse;
    if (s->age < 0) return false;
    for (int32_t t = 0; t < l->tool_count; t++) {
        const tms_tool *tool = &l->tool[t];
        const bool touches = tms_contact_solver_can_touch(tool);
        if (touches != (s->kind[t] != TMS_TOOL_NONE)) return false;
        if (touches && tool->def.mode == TM_TOOL_GRASPER && (s->passed || tool->pose.grip > 0)) return false;
    }
    return is_within(h, 2); /* beyond its margin rows are reused once more, to measure the force jump */
}

/* Predicts the positions of vertices with mass under the forces of the last substep. Condensed vertices among them
 * carry no row and stay in place. */
static void place_tracked(tm_hybrid *h, int32_t t) {
    tms_contact_solver *l = &h->solver_contact;
    const double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t *vertex, count = tm_contact_search_vertices(l->tool[t].search, &vertex);
    for (int32_t i = 0; i < 3 * count; i++) {
        const int32_t v = vertex[i / 3], d = 3 * v + i % 3;
        if (h->vertex_kind[v] == TMS_CONDENSED) continue;
        l->u_m[d] = u_next[d] +
                    (h->vertex_kind[v] == TMS_INTERFACE
                         ? h->interface_mobility_m_N[h->interface_index[d]] * h->reuse->push_N[h->interface_index[d]]
                         : tms_hybrid_mobility(h, d) * l->f[3 * l->slot_of[v] + i % 3]);
    }
}

/* Computes the detection margin of tool t, m: as in the dynamic model, plus its travel per substep. If oscillating
 * tissue lost a loaded row, the force would alternate between zero and double. */
static double margin_of(const tm_hybrid *h, int32_t t) {
    const tms_tool *tool = &h->solver_contact.tool[t];
    const double *was = h->reuse->at_m[t];
    double most = 0;
    for (int c = 0; c < 3; c++)
        most = fmax(most, fmax(fabs(tool->capsule.tip_m[c] - was[c]), fabs(tool->capsule.tail_m[c] - was[3 + c])));
    return MARGIN * tool->def.radius_m + most / (h->reuse->age + 1);
}

static double guess(const tms_contact_solver *l, const tm_contact_row *row, int32_t first, int32_t last) {
    for (int32_t i = first; i < last; i++)
        if (l->previous[i].station == row->station && l->previous[i].face == row->face &&
            l->previous[i].feature == row->feature)
            return l->previous[i].lambda_N;
    return 0;
}

/* Detects the rows of a tracked tool; returns false if one is on condensed tissue. */
static bool look_for(tm_hybrid *h, int32_t t, int32_t first, int32_t last) {
    tms_contact_solver *l = &h->solver_contact;
    tms_tool *tool = &l->tool[t];
    tms_contact_eval *look = &l->probe;
    const double *u_next = tm_world_state(h->world)->u_next_m;
    bool overflowed = false;
    if (!tool->near) return true;
    place_tracked(h, t);
    const int32_t found = tm_contact_search_rows(tool->search, l->mesh->rest_m, l->u_m, &tool->capsule, margin_of(h, t),
                                                 l->previous + first, last - first, look->row + look->count,
                                                 l->def.max_rows - look->count, &overflowed);
    if (overflowed) return false;
    for (int32_t i = look->count, end = look->count + found; i < end; i++) {
        tm_contact_row *row = &look->row[i];
        if (l->passes(l->self, row)) continue;
        if (look->count == TMS_REUSE_ROWS) return false;
        double gap = row->gap_m;
        for (int a = 0; a < 9; a++) {
            const int32_t d = 3 * row->vertex[a / 3] + a % 3;
            if (tms_row_is_in(h, row, a / 3, TMS_CONDENSED)) return false;
            gap += row->weight[a / 3] * row->normal[a % 3] * (row->weight[a / 3] != 0 ? u_next[d] - l->u_m[d] : 0);
        }
        row->lambda_N = guess(l, row, first, last);
        h->reuse->frozen_now[look->count] = -1;
        h->reuse->system.gap_m[look->count] = gap;
        look->row[look->count++] = *row;
    }
    return true;
}

/* Updates frozen rows for the present tool and interface. */
static bool keep_rows(tm_hybrid *h, int32_t first, int32_t last) {
    tms_contact_solver *l = &h->solver_contact;
    tms_contact_reuse *s = h->reuse;
    tms_contact_eval *look = &l->probe;
    for (int32_t i = first; i < last; i++) {
        const int32_t at = look->count++;
        if (at == TMS_REUSE_ROWS) return false;
        tm_contact_row *row = &look->row[at];
        *row = l->previous[i];
        if (l->passes(l->self, row)) return false;
        const double along = tms_contact_reuse_station(&l->tool[row->instrument].capsule, row, row->point_m);
        s->frozen_now[at] = s->frozen[i];
        s->offset_now_m[at] = s->offset_m[i];
        s->system.gap_m[at] =
            s->offset_m[i] - along +
            tms_dot(s->gap_gradient + (int64_t)s->frozen[i] * h->interface_count, h->at_m, h->interface_count);
    }
    return true;
}

/* Computes the coupling of two rows, at least one of them on tissue with mass. */
static double delassus_between(const tm_hybrid *h, const tm_contact_row *row, const tm_contact_row *other,
                               int32_t other_frozen) {
    const double *follow =
        other_frozen < 0 ? NULL : h->reuse->gap_gradient + (int64_t)other_frozen * h->interface_count;
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        if (row->weight[a] == 0) continue;
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * row->vertex[a] + c;
            double moves = 0; /* of the component, by the other row's force */
            if (follow) {
                moves = h->vertex_kind[row->vertex[a]] == TMS_INTERFACE
                            ? h->interface_mobility_m_N[h->interface_index[d]] * follow[h->interface_index[d]]
                            : 0;
            } else {
                for (int b = 0; b < 3; b++)
                    if (other->vertex[b] == row->vertex[a])
                        moves = tms_hybrid_mobility(h, d) * other->weight[b] * other->normal[c];
            }
            sum += row->weight[a] * row->normal[c] * moves;
        }
    }
    return sum;
}

static void fill_system(tm_hybrid *h) {
    const tms_contact_solver *l = &h->solver_contact;
    const tm_contact_row *row = l->probe.row;
    tms_contact_reuse *s = h->reuse;
    tms_reuse_system *m = &s->system;
    m->count = l->probe.count;
    m->cap_N = l->def.force_cap_N;
    for (int32_t i = 0; i < m->count; i++) {
        const int32_t fi = s->frozen_now[i];
        m->row_compliance_m_N[i] = l->def.contact_compliance_m_N / row[i].share;
        m->radius_m[i] = l->tool[row[i].instrument].def.radius_m;
        m->lambda_N[i] = row[i].lambda_N;
        for (int32_t j = 0; j <= i; j++) {
            const int32_t fj = s->frozen_now[j];
            m->delassus_m_N[i][j] = m->delassus_m_N[j][i] = fi >= 0 && fj >= 0 ? s->delassus_m_N[fi][fj]
                                                            : fi < 0 ? delassus_between(h, &row[i], &row[j], fj)
                                                                     : delassus_between(h, &row[j], &row[i], fi);
        }
    }
}

/* Applies the predicted growth of forces. */
static void apply_growth(tm_hybrid *h) {
    tms_contact_reuse *s = h->reuse;
    for (int32_t i = 0; i < s->system.count; i++)
        if (s->frozen_now[i] >= 0)
            s->system.lambda_N[i] =
                fmin(s->system.lambda_N[i] *
                         (1 + (s->age + 1) * s->predicted_growth[h->solver_contact.probe.row[i].instrument]),
                     s->system.cap_N);
}

static void take(tm_hybrid *h) {
    tms_contact_solver *l = &h->solver_contact;
    tms_contact_reuse *s = h->reuse;
    for (int32_t i = 0; i < l->probe.count; i++) {
        l->now.row[i] = l->probe.row[i];
        l->now.row[i].gap_m = tms_reuse_gap(&s->system, i);
        l->now.row[i].lambda_N = s->system.lambda_N[i];
        s->frozen[i] = s->frozen_now[i];
        s->offset_m[i] = s->offset_now_m[i];
    }
    l->now.count = l->previous_count = l->probe.count;
    memcpy(l->previous, l->now.row, (size_t)l->now.count * sizeof *l->now.row);
    tms_contact_solver_sum(l, &l->now);
    for (int32_t i = 0; i < l->used_count; i++) memcpy(l->f + 3 * l->used[i], l->now.fc + 3 * l->used[i], 24);
    s->age++;
    if (l->gathered_age < l->gather_every) l->gathered_age++;
}

bool tms_contact_reuse_advance(tm_hybrid *h) {
    tms_contact_solver *l = &h->solver_contact;
    int32_t first = 0;
    if (!may_follow(h)) return false;
    l->probe.count = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        int32_t last = first;
        while (last < l->previous_count && l->previous[last].instrument == t) last++;
        const bool tracked = h->reuse->kind[t] == TMS_TOOL_TRACKED;
        if (!(tracked ? look_for(h, t, first, last) : keep_rows(h, first, last))) return false;
        first = last;
    }
    fill_system(h);
    if (!tms_reuse_solve(&h->reuse->system)) return false;
    apply_growth(h);
    take(h);
    return true;
}

void tms_contact_reuse_move(tm_hybrid *h) {
    const tms_contact_solver *l = &h->solver_contact;
    const tms_contact_reuse *s = h->reuse;
    double *u_next = tm_world_state(h->world)->u_next_m;
    for (int32_t i = 0; i < l->now.count; i++) {
        const tm_contact_row *row = &l->now.row[i];
        for (int a = 0; a < 9 && s->frozen[i] < 0; a++) {
            const int32_t d = 3 * row->vertex[a / 3] + a % 3;
            if (tms_row_is_in(h, row, a / 3, TMS_DYNAMIC))
                u_next[d] += tms_hybrid_mobility(h, d) * row->weight[a / 3] * row->normal[a % 3] * row->lambda_N;
        }
    }
    sum_push(h);
    for (int32_t k = 0; k < h->interface_count; k++)
        u_next[h->interface[k]] += h->interface_mobility_m_N[k] * s->push_N[k];
}
