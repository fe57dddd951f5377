/* Newton's method on r(f) = f - rows(base + C f): the residual, and the known part of its matrix. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

/* --- shape under forces, its rows, and their forces --- */

/* out += f times the displacements of all slots by that force: a row of the block, which is symmetric and contiguous by
 * row. */
void tms_contact_solver_spread(const tms_contact_solver *l, int32_t component, double f, double *restrict out) {
    tms_add_times(f, l->block + (int64_t)component * 3 * l->capacity, 3 * l->high, out);
}

void tms_contact_solver_response(const tms_contact_solver *l, const int32_t *slot, int32_t count, const double *f,
                                 bool by_slot, double *out) {
    memset(out, 0, 24 * (size_t)l->high);
    for (int32_t j = 0; j < 3 * count; j++) {
        const int32_t d = 3 * slot[j / 3] + j % 3;
        const double force = by_slot ? f[d] : f[j];
        if (force != 0) tms_contact_solver_spread(l, d, force, out);
    }
}

void tms_contact_solver_shape(tms_contact_solver *l) {
    tms_contact_solver_response(l, l->used, l->used_count, l->f, true, l->du);
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int32_t s = l->used[i / 3];
        const int64_t d = 3 * (int64_t)l->vertex[s] + i % 3;
        l->u_m[d] = l->base_m[d] + l->du[3 * s + i % 3];
    }
}

static void add_row(const tms_contact_solver *l, tms_contact_eval *look, const tm_contact_row *row) {
    const tms_tool *tool = &l->tool[row->instrument];
    double on_tool[3], at_tip[3];
    look->capped[row->instrument] |= row->lambda_N >= l->def.force_cap_N;
    for (int c = 0; c < 3; c++) on_tool[c] = -row->lambda_N * row->normal[c];
    tm_tool_tip_force(&tool->def, &tool->pose, row->point_m, on_tool, at_tip);
    for (int c = 0; c < 3; c++)
        look->force_N[row->instrument][c] += at_tip[c], look->resultant_N[row->instrument][c] += on_tool[c];
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++) look->fc[3 * l->slot_of[row->vertex[k]] + c] -= row->weight[k] * on_tool[c];
}

void tms_contact_solver_sum(const tms_contact_solver *l, tms_contact_eval *look) {
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) look->fc[3 * l->used[i] + c] = 0;
    memset(look->force_N, 0, sizeof look->force_N);
    memset(look->resultant_N, 0, sizeof look->resultant_N);
    memset(look->capped, 0, sizeof look->capped);
    for (int32_t i = 0; i < look->count; i++) add_row(l, look, &look->row[i]);
}

void tms_contact_solver_evaluate_shape(tms_contact_solver *l, tms_contact_eval *look, double margin) {
    int32_t first = 0;
    look->count = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_tool *tool = &l->tool[t];
        int32_t last = first;
        while (last < l->previous_count && l->previous[last].instrument == t) last++;
        if (tool->prescribed) {
            const int32_t room = l->def.max_rows - look->count, rows = last - first < room ? last - first : room;
            memcpy(look->row + look->count, l->previous + first, (size_t)rows * sizeof *look->row);
            look->count += rows;
        } else if (tool->near) {
            bool overflowed = false;
            const int32_t found = tm_contact_search_rows(
                tool->search, l->mesh->rest_m, l->u_m, &tool->capsule, margin * tool->def.radius_m, l->previous + first,
                last - first, look->row + look->count, l->def.max_rows - look->count, &overflowed);
            tool->overflowed |= overflowed;
            const int32_t end = look->count + found;
            for (int32_t i = look->count; i < end; i++) {
                if (tms_contact_solver_in_jaws(l, &look->row[i]) || (l->passes && l->passes(l->self, &look->row[i])))
                    continue;
                tm_contact_row *row = &look->row[look->count++];
                *row = look->row[i];
                row->lambda_N = tm_contact_compliance_reaction(l->def.contact_compliance_m_N / row->share,
                                                               tool->def.radius_m, row->gap_m, 0, l->def.force_cap_N);
            }
        }
        first = last;
    }
    tms_contact_solver_sum(l, look);
    if (l->friction) tms_contact_solver_friction(l, look);
}

/* --- LU with partial pivoting of the contact solver's small matrices --- */

bool tms_lu(double *restrict a, int32_t *restrict pivot, int32_t n) {
    for (int32_t k = 0; k < n; k++) {
        int32_t best = k;
        for (int32_t i = k + 1; i < n; i++)
            if (fabs(a[(int64_t)i * n + k]) > fabs(a[(int64_t)best * n + k])) best = i;
        pivot[k] = best;
        if (!(fabs(a[(int64_t)best * n + k]) > 1e-300)) return false;
        if (best != k)
            for (int32_t j = 0; j < n; j++) {
                const double t = a[(int64_t)k * n + j];
                a[(int64_t)k * n + j] = a[(int64_t)best * n + j];
                a[(int64_t)best * n + j] = t;
            }
        const double *restrict top = a + (int64_t)k * n;
        const double inverse = 1 / top[k];
        for (int32_t i = k + 1; i < n; i++) {
            double *restrict row = a + (int64_t)i * n;
            const double factor = row[k] * inverse;
            row[k] = factor;
            if (factor != 0)
                for (int32_t j = k + 1; j < n; j++) row[j] -= factor * top[j];
        }
    }
    return true;
}

void tms_lu_solve(const double *a, const int32_t *pivot, int32_t n, double *x) {
    for (int32_t k = 0; k < n; k++) { /* complete rows were swapped, so all swaps come first */
        const double t = x[k];
        x[k] = x[pivot[k]];
        x[pivot[k]] = t;
    }
    for (int32_t i = 1; i < n; i++) {
        double sum = 0;
        for (int32_t j = 0; j < i; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] -= sum;
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        double sum = 0;
        for (int32_t j = i + 1; j < n; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] = (x[i] - sum) / a[(int64_t)i * n + i];
    }
}

static const double CONVERGED = 1e-9;   /* relative to the largest displacement by the forces */
static const double TOUCHING_M = 1e-13; /* smaller gaps cannot be distinguished from contact */

/* Returns whether jaws of the omitted tool pin the slot (-1: no tool). */
static bool pinned_by(const tms_contact_solver *l, int32_t slot, int32_t tool) {
    return tool >= 0 && l->pin_of[slot] >= 0 && tms_pin_of(l, slot)->tool == tool;
}

/* --- residual --- */

/* Limits a fading spring in this shape: elastic up to its maximum force, constant beyond. */
static void limit_springs(tms_contact_solver *l) {
    for (int32_t i = l->imposed_count; i < l->pin_count; i++) {
        tms_pin *pin = &l->pin[i];
        double stretch[3], size = 0;
        if (!pin->fades) continue;
        for (int c = 0; c < 3; c++) {
            stretch[c] = pin->u_m[c] - l->u_m[3 * (int64_t)pin->vertex + c];
            size += stretch[c] * stretch[c];
        }
        size = sqrt(size);
        pin->prescribed = size >= pin->max_N * pin->compliance_m_N;
        for (int c = 0; c < 3; c++) pin->force_N[c] = pin->prescribed && size > 0 ? pin->max_N * stretch[c] / size : 0;
        pin->rotation_N_m = pin->prescribed && size > 0 ? pin->max_N / size : 0;
    }
}

/* Computes the residual of each slot in use: N; m for an imposed displacement. Returns the sum of squares of the
 * displacements that it would cause; `small`: all are within tolerance. */
static double residual(tms_contact_solver *l, bool *small) {
    double merit = 0, most = 1e-15, worst = 0;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    for (int32_t i = 0; i < l->used_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t s = l->used[i], d = 3 * s + c;
            const bool given = l->pin_of[s] >= 0 && tms_pin_of(l, s)->prescribed;
            const double own =
                             given ? tms_pin_of(l, s)->compliance_m_N : l->block[d * c3 + d], /* no jump between both */
                free_r = l->f[d] - l->now.fc[d] - (given ? tms_pin_of(l, s)->force_N[c] : 0);
            const bool held = tms_is_pinned(l, s, c);
            l->r[d] = held ? l->u_m[3 * (int64_t)l->vertex[s] + c] - tms_pin_of(l, s)->u_m[c] +
                                 tms_pin_of(l, s)->compliance_m_N * free_r
                           : free_r;
            const double off = held ? l->r[d] : own * l->r[d];
            merit += off * off;
            most = fmax(most, fabs(own * l->f[d]));
            worst = fmax(worst, fabs(off));
        }
    *small = worst <= CONVERGED * most + TOUCHING_M;
    l->nearly = worst <= l->loose_tolerance * most;
    return merit;
}

double tms_contact_solver_evaluate(tms_contact_solver *l) {
    tms_contact_solver_shape(l);
    tms_contact_solver_evaluate_shape(l, &l->now, 0);
    limit_springs(l);
    return residual(l, &l->converged);
}

/* --- the known part of the matrix: I + D C, pinned rows C + s (I + D C) --- */

enum { GIVEN = -2 }; /* during the selection: only under prescribed rows */

/* Selects the slots with unknown force: under a row, loaded, or pinned. */
static void choose_active(tms_contact_solver *l) {
    for (int32_t s = 0; s < l->capacity; s++) l->active_of[s] = -1;
    for (int32_t i = 0; i < l->now.count; i++)
        for (int k = 0; k < 3; k++) {
            int32_t *of = &l->active_of[l->slot_of[l->now.row[i].vertex[k]]];
            *of = l->tool[l->now.row[i].instrument].prescribed ? (*of < 0 ? GIVEN : *of) : 0;
        }
    l->active_count = 0;
    for (int32_t i = 0; i < l->used_count; i++) {
        const int32_t s = l->used[i];
        const bool loaded = l->f[3 * s] != 0 || l->f[3 * s + 1] != 0 || l->f[3 * s + 2] != 0;
        if (l->active_of[s] < 0 && l->pin_of[s] < 0 && (l->active_of[s] == GIVEN || !loaded)) continue;
        l->active_of[s] = l->active_count;
        l->active[l->active_count++] = s;
    }
}

/* Adds one row's D = G G^T / slope, G = weight * normal: lu += G (C^T G)^T / slope. */
static void add_row_matrix(tms_contact_solver *l, const tm_contact_row *row, int32_t m) {
    if (row->lambda_N >= l->def.force_cap_N) return;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    const double slope = tm_contact_compliance_slope(l->def.contact_compliance_m_N / row->share,
                                                     l->tool[row->instrument].def.radius_m, row->lambda_N);
    double *move = l->step; /* of each unknown's force along the row */
    memset(move, 0, 8 * (size_t)m);
    for (int a = 0; a < 9; a++) {
        const double *C = l->block + (3 * l->slot_of[row->vertex[a / 3]] + a % 3) * c3,
                     G = row->weight[a / 3] * row->normal[a % 3] / slope;
        for (int32_t j = 0; j < l->active_count && G != 0; j++)
            for (int c = 0; c < 3; c++) move[3 * j + c] += G * C[3 * l->active[j] + c];
    }
    for (int a = 0; a < 9; a++) {
        double *out = l->lu + (int64_t)(3 * l->active_of[l->slot_of[row->vertex[a / 3]]] + a % 3) * m;
        const double G = row->weight[a / 3] * row->normal[a % 3];
        for (int32_t j = 0; j < m && G != 0; j++) out[j] += G * move[j];
    }
}

bool tms_contact_solver_factor(tms_contact_solver *l, int32_t without) {
    choose_active(l);
    const int32_t m = 3 * l->active_count;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    memset(l->lu, 0, sizeof(double) * (size_t)m * (size_t)m);
    for (int32_t i = 0; i < l->now.count; i++)
        if (l->now.row[i].lambda_N > 0 && l->now.row[i].instrument != without &&
            !l->tool[l->now.row[i].instrument].prescribed)
            add_row_matrix(l, &l->now.row[i], m);
    for (int32_t k = 0; k < l->now.station_count; k++)
        if (l->now.row[l->now.station[k].first].instrument != without)
            tms_contact_solver_add_friction_matrix(l, &l->now.station[k], m);
    for (int32_t i = 0; i < m; i++) l->lu[(int64_t)i * m + i] += 1;
    for (int32_t i = 0; i < m; i++) {
        double *row = l->lu + (int64_t)i * m;
        const double *C = l->block + (3 * l->active[i / 3] + i % 3) * c3;
        const int32_t pin = l->pin_of[l->active[i / 3]];
        for (int k = 0; k < 3 && pin >= 0 && l->pin[pin].prescribed && !pinned_by(l, l->active[i / 3], without); k++)
            for (int32_t j = 0; j < m; j++)
                row[j] -= tms_pin_rotates(&l->pin[pin], i % 3, k) *
                          l->block[(3 * l->active[i / 3] + k) * c3 + 3 * l->active[j / 3] + j % 3];
        if (!tms_is_pinned(l, l->active[i / 3], i % 3) || pinned_by(l, l->active[i / 3], without)) continue;
        for (int32_t j = 0; j < m; j++)
            row[j] = C[3 * l->active[j / 3] + j % 3] + tms_pin_of(l, l->active[i / 3])->compliance_m_N * row[j];
    }
    return tms_lu(l->lu, l->pivot, m);
}

double tms_contact_solver_scale(const tms_contact_solver *l, int32_t j) {
    const int64_t d = 3 * l->active[j / 3] + j % 3;
    return tms_is_pinned(l, l->active[j / 3], j % 3) ? 1 : l->block[d * 3 * l->capacity + d] + 1e-300;
}

/* --- compliance with the reaction of other tools --- */

bool tms_contact_solver_without(tms_contact_solver *l, int32_t tool) { return tms_contact_solver_factor(l, tool); }

void tms_contact_solver_yield(tms_contact_solver *l, int32_t tool, const double *u, double *df) {
    const int32_t m = 3 * l->active_count;
    memset(df, 0, 8 * (size_t)m);
    for (int32_t i = 0; i < l->now.count; i++) {
        const tm_contact_row *row = &l->now.row[i];
        if (row->instrument == tool || row->lambda_N <= 0 || row->lambda_N >= l->def.force_cap_N) continue;
        double along = 0;
        for (int a = 0; a < 9; a++)
            along +=
                row->weight[a / 3] * row->normal[a % 3] * u[3 * l->active_of[l->slot_of[row->vertex[a / 3]]] + a % 3];
        along /= tm_contact_compliance_slope(l->def.contact_compliance_m_N / row->share,
                                             l->tool[row->instrument].def.radius_m, row->lambda_N);
        for (int a = 0; a < 9; a++)
            df[3 * l->active_of[l->slot_of[row->vertex[a / 3]]] + a % 3] -=
                row->weight[a / 3] * row->normal[a % 3] * along;
    }
    for (int32_t j = 0; j < m; j++)
        if (tms_is_pinned(l, l->active[j / 3], j % 3) && !pinned_by(l, l->active[j / 3], tool))
            df[j] = -u[j] + tms_pin_of(l, l->active[j / 3])->compliance_m_N * df[j];
    tms_lu_solve(l->lu, l->pivot, m, df);
}
