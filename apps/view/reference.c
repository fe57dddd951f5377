#include "reference.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"

typedef struct view_reference reference;

void view_references_free(view_references *r) {
    free(r->item);
    memset(r, 0, sizeof *r);
}

static int by_id(const void *a, const void *b) {
    const reference *p = a, *q = b;
    return p->id < q->id ? -1 : p->id > q->id;
}

/* Copies known reference positions and marks them in `known`. Returns how many vertices are unknown. */
static int32_t recall(const view_references *r, const view_surface *s, float *at_m, uint8_t *known) {
    int32_t unknown = 0;
    for (int32_t v = 0; v < s->vertex_count; v++) {
        const reference wanted = {.id = s->vertex_id[v]},
                        *old = r->count && r->session == s->session
                                   ? bsearch(&wanted, r->item, (size_t)r->count, sizeof wanted, by_id)
                                   : NULL;
        vset(old ? old->at_m : s->vertex_m + 3 * v, at_m + 3 * v);
        known[v] = old != NULL;
        unknown += !old;
    }
    return unknown;
}

/* Assigns unknown vertices next to known ones, layer by layer. sum[4*vertex_count]: displacements and their number. */
static void follow(const view_surface *s, float *at_m, uint8_t *known, float *sum) {
    for (bool more = true; more;) {
        more = false;
        memset(sum, 0, 4 * (size_t)s->vertex_count * sizeof *sum);
        for (int32_t c = 0; c < 3 * s->triangle_count; c++) {
            const int32_t a = s->triangle[c];
            if (!known[a]) continue;
            float moved[3];
            vsub(at_m + 3 * a, s->vertex_m + 3 * a, moved);
            for (int k = 0; k < 3; k++) {
                const int32_t b = s->triangle[c - c % 3 + k];
                if (!known[b]) vadd(sum + 4 * b, 1, moved), sum[4 * b + 3]++;
            }
        }
        for (int32_t v = 0; v < s->vertex_count; v++) {
            if (known[v] || !(sum[4 * v + 3] > 0)) continue;
            vmadd(s->vertex_m + 3 * v, 1 / sum[4 * v + 3], sum + 4 * v, at_m + 3 * v);
            known[v] = 1, more = true;
        }
    }
}

bool view_references_update(view_references *r, const view_surface *s, float *at_m) {
    const size_t vertices = (size_t)s->vertex_count;
    reference *now = malloc((vertices + 1) * sizeof *now);
    uint8_t *known = malloc(vertices + 1);
    float *sum = malloc((4 * vertices + 1) * sizeof *sum);
    const bool good = now && known && sum;
    if (good) {
        const int32_t unknown = recall(r, s, at_m, known);
        if (unknown && unknown < s->vertex_count) follow(s, at_m, known, sum);
        for (int32_t v = 0; v < s->vertex_count; v++) {
            now[v].id = s->vertex_id[v];
            vset(at_m + 3 * v, now[v].at_m);
        }
        qsort(now, vertices, sizeof *now, by_id);
        free(r->item);
        r->item = now, r->count = s->vertex_count, r->session = s->session;
    } else
        free(now);
    free(known);
    free(sum);
    return good;
}

/* Returns noise of 0 to 1 at a lattice point. */
static float lattice(int32_t x, int32_t y, int32_t z) {
    uint32_t h = (uint32_t)x * 0x8da6b343u ^ (uint32_t)y * 0xd8163841u ^ (uint32_t)z * 0xcb1ab31fu;
    h = (h ^ h >> 13) * 0x5bd1e995u;
    return (float)((h ^ h >> 15) & 0xffffff) / 16777216.0f;
}

static float noise(const float at_m[3], float cell_m, float offset) {
    int32_t i[3];
    float u[3], sum = 0;
    for (int k = 0; k < 3; k++) {
        float x = fminf(fmaxf(at_m[k] / cell_m + offset, -1e6f), 1e6f), base = floorf(x);
        i[k] = (int32_t)base;
        u[k] = (x - base) * (x - base) * (3 - 2 * (x - base));
    }
    for (int c = 0; c < 8; c++)
        sum += (c & 1 ? u[0] : 1 - u[0]) * (c & 2 ? u[1] : 1 - u[1]) * (c & 4 ? u[2] : 1 - u[2]) *
               lattice(i[0] + (c & 1), i[1] + (c >> 1 & 1), i[2] + (c >> 2));
    return sum;
}

void view_reference_mottle(const float at_m[3], float grain_m, float mottle[2]) {
    mottle[0] = 0.65f * noise(at_m, grain_m * 9, 7.3f) + 0.35f * noise(at_m, grain_m * 3.2f, 0);
    mottle[1] = noise(at_m, grain_m * 17, 31.7f);
}
