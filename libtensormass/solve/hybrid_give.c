/* How far the hybrid gives within a substep: what has mass as that lets it, inner vertices quasi-statically and through
 * the interface. */
#include "hybrid.h"

#include <string.h>

double tms_hybrid_mobility(const tm_hybrid *h, int32_t dof) {
    return h->held[dof] ? 0 : tm_world_mobility_s2_kg(h->world)[dof / 3];
}

/* Gathered when its slot is new. */
const double *tms_hybrid_through(tm_hybrid *h, int32_t vertex) {
    const tms_local *l = &h->local;
    const int32_t slot = l->slot_of[vertex], n = h->interface_count;
    double *row = h->through + 3 * (int64_t)slot * n;
    if (h->through_vertex[slot] == vertex) return row;
    h->through_vertex[slot] = vertex;
    for (int c = 0; c < 3; c++) {
        const int32_t at = h->place[3 * vertex + c];
        for (int32_t k = 0; k < n; k++)
            row[(int64_t)c * n + k] = at < 0 ? 0 : tms_response(&h->responses, h->responses.kept_count + k, at);
        float *single = h->through_single + (3 * (int64_t)slot + c) * h->coupling.padded;
        for (int32_t k = 0; k < h->coupling.padded; k++) single[k] = k < n ? (float)row[(int64_t)c * n + k] : 0;
    }
    return row;
}

static void inside_inside(tm_hybrid *h, int32_t a, int32_t b, double C[9]) {
    const int32_t n = h->interface_count;
    const double *ra = tms_hybrid_through(h, a), *rb = tms_hybrid_through(h, b);
    tms_weighted_dots(ra, h->give_m_N, rb, n, C);
    for (int i = 0; i < 9; i++) {
        const int32_t row = h->place[3 * a + i / 3], column = h->place[3 * b + i % 3];
        if (row >= 0 && column >= 0) C[i] += tms_response(&h->responses, column, row);
    }
}

void tms_hybrid_compliance(void *self, int32_t a, int32_t b, double C[9]) {
    tm_hybrid *h = self;
    const bool in_a = h->part[a] == TMS_CONDENSED, in_b = h->part[b] == TMS_CONDENSED;
    memset(C, 0, 72);
    if (in_a && in_b) {
        inside_inside(h, a, b, C);
    } else if (in_a || in_b) {
        const int32_t inside = in_a ? a : b, other = in_a ? b : a;
        if (h->part[other] != TMS_INTERFACE) return;
        const double *row = tms_hybrid_through(h, inside);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int32_t k = h->place[3 * other + j];
                C[in_a ? 3 * i + j : 3 * j + i] = row[(int64_t)i * h->interface_count + k] * h->give_m_N[k];
            }
    } else if (a == b) {
        for (int i = 0; i < 3; i++) C[4 * i] = tms_hybrid_mobility(h, 3 * a + i);
    }
}

/* The condensed surface as contact looks for what is around a tool: its inside follows the border's softest shapes, and
 * gives where tools press. Near enough to choose triangles by; what is chosen is then placed exactly. So nobody needs
 * the inside's own solution in a frame, and whether somebody has asked for it changes no bit of the next one. */

/* Of kept component `at` for the border's shape j; every component of a small border is one. */
static void fill_rows(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const int32_t kept = h->responses.kept_count;
    for (int32_t k = 0; k < c->n; k++)
        for (int32_t at = 0; at < kept; at++) {
            const float G = (float)tms_response(&h->responses, kept + k, at);
            float *restrict row = h->around + (int64_t)at * h->around_width;
            const float *restrict shape = c->shape + (int64_t)k * h->around_width;
            if (c->rank == 0)
                row[k] = G;
            else
                for (int32_t j = 0; j < h->around_width; j++) row[j] += G * shape[j];
        }
}

bool tms_hybrid_make_around(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const size_t kept = (size_t)h->responses.kept_count;
    h->around_width = c->rank ? c->rank : c->padded;
    h->around = tms_take_zeroed(kept * (size_t)h->around_width + 1, 4);
    h->around_by = tms_take_zeroed((size_t)h->around_width + 1, 4);
    h->around_m = tms_take((kept + 1) * 4);
    if (!h->around || !h->around_by || !h->around_m) return false;
    fill_rows(h);
    return true;
}

/* How much of each shape the border has. */
static void measure(tm_hybrid *h) {
    const tms_coupling *c = &h->coupling;
    const double *u = tm_world_state(h->world)->u_m;
    memset(h->around_by, 0, 4 * (size_t)h->around_width);
    for (int32_t k = 0; k < c->n; k++) {
        const float at = (float)u[h->interface[k]];
        if (c->rank == 0)
            h->around_by[k] = at;
        else
            for (int32_t j = 0; j < c->rank; j++) h->around_by[j] += c->shape[(int64_t)k * c->rank + j] * at;
    }
}

void tms_hybrid_look_around(void *self) {
    tm_hybrid *h = self;
    const tms_local *l = &h->local;
    const int32_t kept = h->responses.kept_count;
    const double *u = tm_world_state(h->world)->u_m;
    for (int32_t v = 0; v < h->mesh->vertex_count; v++)
        memcpy(l->u_m + 3 * (int64_t)v, (h->part[v] == TMS_CONDENSED ? h->value_m : u) + 3 * (int64_t)v, 24);
    measure(h);
    tms_rows_times(h->around, kept, h->around_width, h->around_by, h->around_m);
    for (int32_t at = 0; at < kept; at++) l->u_m[h->responses.kept[at]] = h->responses.base_m[at] + h->around_m[at];
    for (int32_t i = 0; i < 3 * l->use_count; i++) {
        const int32_t s = l->use[i / 3], d = 3 * l->vertex[s] + i % 3;
        const double f = l->f[3 * s + i % 3];
        if (f == 0 || h->part[d / 3] != TMS_CONDENSED || h->place[d] < 0) continue;
        for (int32_t at = 0; at < kept; at++)
            l->u_m[h->responses.kept[at]] += f * tms_response(&h->responses, h->place[d], at);
    }
}
