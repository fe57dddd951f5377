/* The tangent of averaged changes of volume: of every pair of vertices that shares a domain. */
#include <string.h>

#include "tissue/tangent.h"

void tm_tangent_add(const tm_tissue *tissue, tm_force_graph *graph, int32_t k, int32_t l, const double K[9]) {
    double sum[9];
    if (k == l) {
        for (int i = 0; i < 9; i++) graph->vertex_tensor[9 * (int64_t)k + i] += K[i];
        return;
    }
    const int32_t slot = tm_tissue_edge_slot(tissue, tm_tissue_find_pair(tissue, k, l));
    tm_edge_read(graph, slot, sum);
    for (int i = 0; i < 9; i++) sum[i] += K[i];
    tm_edge_write(graph, slot, sum);
}

/* Averaged gradients of one domain's members, turned, into `gradient`. */
static void turned_gradient(const tm_swollen *s, int32_t owner, int32_t i, double *gradient) {
    const tm_domains *d = tm_swollen_domains_of(s);
    const tm_mesh *mesh = s->field.mesh;
    const int32_t from = d->member_at[i];
    memset(gradient, 0, 3 * sizeof(double) * (size_t)(d->member_at[i + 1] - from));
    for (int32_t j = mesh->vertex_tet_begin[owner]; j < mesh->vertex_tet_begin[owner + 1]; j++) {
        const int32_t t = mesh->vertex_tet[j];
        if (!s->field.alive[t] || s->field.smoothed->law[mesh->region[t]] != d->law[i]) continue;
        const double *R = s->turn + 9 * TM_LANES * (int64_t)(t / TM_LANES) + t % TM_LANES;
        const double share = s->quarter_m3[t] / d->volume_m3[i];
        for (int k = 0; k < 4; k++) {
            const double *alpha = mesh->shape_1_m + 12 * (int64_t)t + 3 * k;
            int32_t m = from;
            while (d->member[m] != mesh->tet[4 * (int64_t)t + k]) m++;
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    gradient[3 * (m - from) + a] += share * R[TM_LANES * (3 * a + b)] * alpha[b];
        }
    }
}

static void add_domain(const tm_tissue *tissue, const tm_swollen *s, int32_t i, const double *turned,
                       tm_tangent *tangent) {
    const tm_domains *d = tm_swollen_domains_of(s);
    const int32_t from = d->member_at[i], to = d->member_at[i + 1];
    const double bulk = s->bulk_Pa[d->law[i]], stiffness = bulk * d->volume_m3[i];
    const double steep = tangent->definite || bulk * s->swelling[i] < s->most_Pa[d->law[i]] ? stiffness : 0;
    for (int32_t m = from; m < to; m++)
        for (int32_t n = m; n < to && d->lives[m]; n++) {
            if (!d->lives[n]) continue;
            double K[9];
            const double *a = turned + 3 * (m - from), *b = turned + 3 * (n - from);
            const double *a0 = d->gradient + 3 * (int64_t)m, *b0 = d->gradient + 3 * (int64_t)n;
            for (int k = 0; k < 9; k++) K[k] = steep * a[k / 3] * b[k % 3] - stiffness * a0[k / 3] * b0[k % 3];
            tm_tangent_add(tissue, &tangent->graph, d->member[m], d->member[n], K);
        }
}

void tm_swollen_tangent(const tm_tissue *tissue, int32_t begin, int32_t end, tm_tangent *tangent) {
    const tm_swollen *s = &tangent->swollen;
    const tm_domains *d = tm_swollen_domains_of(s);
    for (int32_t v = begin; v < end; v++)
        for (int32_t i = d->begin[v]; i < d->begin[v + 1]; i++) {
            if (!(d->volume_m3[i] > 0)) continue;
            turned_gradient(s, v, i, tangent->gradient);
            add_domain(tissue, s, i, tangent->gradient, tangent);
        }
}

int32_t tm_swollen_most_members(const tm_swollen *s) {
    const tm_domains *d = tm_swollen_domains_of(s);
    int32_t most = 0;
    for (int32_t i = 0; i < d->count; i++)
        if (d->member_at[i + 1] - d->member_at[i] > most) most = d->member_at[i + 1] - d->member_at[i];
    return most;
}
