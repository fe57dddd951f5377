/* The condensed surface as contact looks for what is around a tool: its inside follows the border's softest shapes, and
 * gives where tools press. Near enough to choose triangles by; what is chosen is then placed exactly. So nobody needs
 * the inside's own solution in a frame, and whether somebody has asked for it changes no bit of the next one. */
#include "hybrid.h"

#include <string.h>

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
