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
