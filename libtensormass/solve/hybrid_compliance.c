/* Compliance of the hybrid model within a substep: dynamic vertices by their mass, interior ones quasi-statically and
 * through the interface. */
#include "hybrid.h"

#include <string.h>

double tms_hybrid_mobility(const tm_hybrid *h, int32_t dof) {
    return h->fixed_dof[dof] ? 0 : tm_world_mobility_s2_kg(h->world)[dof / 3];
}

/* Computed when its slot is new. */
const double *tms_hybrid_constraint_mode(tm_hybrid *h, int32_t vertex) {
    const tms_contact_solver *l = &h->solver_contact;
    const int32_t slot = l->slot_of[vertex], n = h->interface_count;
    double *row = h->constraint_mode + 3 * (int64_t)slot * n;
    if (h->constraint_mode_vertex[slot] == vertex) return row;
    h->constraint_mode_vertex[slot] = vertex;
    for (int c = 0; c < 3; c++) {
        const int32_t at = h->interface_index[3 * vertex + c];
        for (int32_t k = 0; k < n; k++)
            row[(int64_t)c * n + k] = at < 0 ? 0 : tms_response(&h->responses, h->responses.kept_count + k, at);
        float *single = h->constraint_mode_single + (3 * (int64_t)slot + c) * h->coupling.padded;
        for (int32_t k = 0; k < h->coupling.padded; k++) single[k] = k < n ? (float)row[(int64_t)c * n + k] : 0;
    }
    return row;
}

static void inside_inside(tm_hybrid *h, int32_t a, int32_t b, double C[9]) {
    const int32_t n = h->interface_count;
    const double *ra = tms_hybrid_constraint_mode(h, a), *rb = tms_hybrid_constraint_mode(h, b);
    tms_weighted_dots(ra, h->interface_mobility_m_N, rb, n, C);
    for (int i = 0; i < 9; i++) {
        const int32_t row = h->interface_index[3 * a + i / 3], column = h->interface_index[3 * b + i % 3];
        if (row >= 0 && column >= 0) C[i] += tms_response(&h->responses, column, row);
    }
}

void tms_hybrid_compliance(void *self, int32_t a, int32_t b, double C[9]) {
    tm_hybrid *h = self;
    const bool in_a = h->vertex_kind[a] == TMS_CONDENSED, in_b = h->vertex_kind[b] == TMS_CONDENSED;
    memset(C, 0, 72);
    if (in_a && in_b) {
        inside_inside(h, a, b, C);
    } else if (in_a || in_b) {
        const int32_t inside = in_a ? a : b, other = in_a ? b : a;
        if (h->vertex_kind[other] != TMS_INTERFACE) return;
        const double *row = tms_hybrid_constraint_mode(h, inside);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int32_t k = h->interface_index[3 * other + j];
                C[in_a ? 3 * i + j : 3 * j + i] =
                    row[(int64_t)i * h->interface_count + k] * h->interface_mobility_m_N[k];
            }
    } else if (a == b) {
        for (int i = 0; i < 3; i++) C[4 * i] = tms_hybrid_mobility(h, 3 * a + i);
    }
}

/* Approximate condensed surface, to select triangles around a tool. Its interior follows the interface's softest modes,
 * and yields under tools. The selected triangles are then placed exactly. A frame thus never needs the interior's full
 * solution, and requesting it changes no bit of the next frame. */

/* Computes kept component `at` for the interface's mode j; for a small interface each component is a mode. */
static void fill_rows(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const int32_t kept = h->responses.kept_count;
    for (int32_t k = 0; k < c->n; k++)
        for (int32_t at = 0; at < kept; at++) {
            const float G = (float)tms_response(&h->responses, kept + k, at);
            float *restrict row = h->neighbourhood + (int64_t)at * h->neighbourhood_width;
            const float *restrict shape = c->shape + (int64_t)k * h->neighbourhood_width;
            if (c->rank == 0)
                row[k] = G;
            else
                for (int32_t j = 0; j < h->neighbourhood_width; j++) row[j] += G * shape[j];
        }
}

bool tms_hybrid_build_neighbourhood(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const size_t kept = (size_t)h->responses.kept_count;
    h->neighbourhood_width = c->rank ? c->rank : c->padded;
    h->neighbourhood = tms_alloc_zeroed(kept * (size_t)h->neighbourhood_width + 1, 4);
    h->neighbourhood_by = tms_alloc_zeroed((size_t)h->neighbourhood_width + 1, 4);
    h->neighbourhood_m = tms_alloc((kept + 1) * 4);
    if (!h->neighbourhood || !h->neighbourhood_by || !h->neighbourhood_m) return false;
    fill_rows(h);
    return true;
}

/* Computes the amplitude of each mode of the interface. */
static void measure(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const double *u = tm_world_state(h->world)->u_m;
    memset(h->neighbourhood_by, 0, 4 * (size_t)h->neighbourhood_width);
    for (int32_t k = 0; k < c->n; k++) {
        const float at = (float)u[h->interface[k]];
        if (c->rank == 0)
            h->neighbourhood_by[k] = at;
        else
            for (int32_t j = 0; j < c->rank; j++) h->neighbourhood_by[j] += c->shape[(int64_t)k * c->rank + j] * at;
    }
}

void tms_hybrid_estimate_neighbourhood(void *self) {
    tm_hybrid *h = self;
    const tms_contact_solver *l = &h->solver_contact;
    const int32_t kept = h->responses.kept_count;
    const double *u = tm_world_state(h->world)->u_m;
    for (int32_t v = 0; v < h->mesh->vertex_count; v++)
        memcpy(l->u_m + 3 * (int64_t)v, (h->vertex_kind[v] == TMS_CONDENSED ? h->value_m : u) + 3 * (int64_t)v, 24);
    measure(h);
    tms_rows_times(h->neighbourhood, kept, h->neighbourhood_width, h->neighbourhood_by, h->neighbourhood_m);
    for (int32_t at = 0; at < kept; at++)
        l->u_m[h->responses.kept[at]] = h->responses.base_m[at] + h->neighbourhood_m[at];
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int32_t s = l->used[i / 3], d = 3 * l->vertex[s] + i % 3;
        const double f = l->f[3 * s + i % 3];
        if (f == 0 || h->vertex_kind[d / 3] != TMS_CONDENSED || h->interface_index[d] < 0) continue;
        for (int32_t at = 0; at < kept; at++)
            l->u_m[h->responses.kept[at]] += f * tms_response(&h->responses, h->interface_index[d], at);
    }
}
