/* Irons' bound over smoothing domains. The stiffness is a sum over them, K = sum of K_d, and over single tetrahedra for
 * the part that is not smoothed. Each K_d is bounded by a diagonal, K_d <= diag(demand_d), demand_d =
 * lambda_max(diag(w)^-1 K_d) w for any weights w > 0 of its members. So K <= diag(sum of demand) <= most M bounds
 * omega^2 as in critical_step_weighted.c. The average over a vertex has rank one: there lambda_max is a sum. Weights
 * begin in proportion to the gradients' lengths (for rank one, the row sums of |K_d|) and then follow demand. */
#include "material/law.h"
#include "tissue/strain_smoothing_pairs.h"

#include <math.h>
#include <string.h>

/* Members of one kind of domain with their demands. */
typedef struct kind {
    const tm_domains *domains; /* null: single tetrahedra */
    double *weight, *demand;   /* [members], kg/s2 */
} kind;

typedef struct bound {
    tm_pool pool;
    const tm_tissue *tissue;
    tm_domains vertex, edge;
    kind kinds[3];
    int kind_count;
    double *load; /* [vertex_count] sum of demand over mass, 1/s2 */
} bound;

/* Four sweeps bring nine tenths of the gain of twelve. */
enum { SWEEPS = 5 };
static const double MIN_LOAD = 0.05;

typedef struct members {
    int32_t count;
    const int32_t *vertex;
    const double *gradient;
} members;

static int32_t groups(const bound *b, const kind *k) {
    return k->domains ? k->domains->count : b->tissue->mesh->tet_count;
}

/* Returns the members of a domain; none where all are removed. `at` is the first member's index. */
static members group(const bound *b, const kind *k, int32_t i, int64_t *at) {
    const tm_domains *d = k->domains;
    const tm_mesh *mesh = b->tissue->mesh;
    if (!d) {
        *at = 4 * (int64_t)i;
        return (members){b->tissue->alive[i] ? 4 : 0, mesh->tet + *at, mesh->shape_1_m + 12 * (int64_t)i};
    }
    *at = d->member_at[i];
    return (members){d->volume_m3[i] > 0 ? d->member_at[i + 1] - d->member_at[i] : 0, d->member + *at,
                     d->gradient + 3 * *at};
}

static double eigenvalue(const bound *b, const kind *k, int32_t i, members m, const double *weight) {
    const tm_smoothed *s = b->tissue->smoothed;
    const tm_domains *d = k->domains;
    if (d && !d->of_edges) {
        double sum = 0;
        for (int32_t j = 0; j < m.count; j++)
            if (weight[j] > 0) sum += vdot(m.gradient + 3 * j, m.gradient + 3 * j) / weight[j];
        return s->bulk_Pa[d->law[i]] * d->volume_m3[i] * sum;
    }
    double G[36] = {0}, law_Pa[36];
    for (int32_t j = 0; j < m.count; j++)
        if (weight[j] > 0) tm_strain_gram_add(m.gradient + 3 * j, 1 / weight[j], G);
    if (d && d->law_Pa)
        memcpy(law_Pa, d->law_Pa + 36 * (int64_t)i, sizeof law_Pa);
    else
        tm_material_voigt(s->remainder + (d ? d->law[i] : b->tissue->mesh->region[i]),
                          d ? NULL : tm_tissue_tet_fibre(b->tissue, i), law_Pa);
    const double share = d ? s->shear : s->law[b->tissue->mesh->region[i]] < 0 ? 1 : 1 - s->shear;
    return share * (d ? d->volume_m3[i] : b->tissue->mesh->volume_m3[i]) * tm_law_eigenvalue_over(law_Pa, G);
}

/* Sets the first weights: 0 for a member without gradient. A small gradient gets a minimum weight, so that the others
 * do not take all of the demand. */
static void first_weights(const bound *b, const kind *k) {
    for (int32_t i = 0; i < groups(b, k); i++) {
        int64_t at;
        const members m = group(b, k, i, &at);
        double most = 0;
        for (int32_t j = 0; j < m.count; j++) most = fmax(most, vdot(m.gradient + 3 * j, m.gradient + 3 * j));
        for (int32_t j = 0; j < m.count; j++) {
            const double length2 = vdot(m.gradient + 3 * j, m.gradient + 3 * j);
            k->weight[at + j] = length2 > 0 ? sqrt(fmax(length2, 1e-6 * most)) : 0;
        }
    }
}

/* Computes all demands with their weights; returns the largest load and its vertex. */
static double demand_all(bound *b, int32_t *worst) {
    const tm_mesh *mesh = b->tissue->mesh;
    memset(b->load, 0, sizeof(double) * (size_t)mesh->vertex_count);
    for (const kind *k = b->kinds; k < b->kinds + b->kind_count; k++)
        for (int32_t i = 0; i < groups(b, k); i++) {
            int64_t at;
            const members m = group(b, k, i, &at);
            if (m.count == 0) continue;
            const double most = eigenvalue(b, k, i, m, k->weight + at);
            for (int32_t j = 0; j < m.count; j++) {
                k->demand[at + j] = most * k->weight[at + j];
                b->load[m.vertex[j]] += k->demand[at + j];
            }
        }
    double most = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        if (!(b->tissue->mass_kg[v] > 0)) continue;
        b->load[v] /= b->tissue->mass_kg[v];
        if (b->load[v] > most) most = b->load[v], *worst = v;
    }
    return most;
}

static void follow_loads(const bound *b, double most) {
    for (const kind *k = b->kinds; k < b->kinds + b->kind_count; k++)
        for (int32_t i = 0; i < groups(b, k); i++) {
            int64_t at;
            const members m = group(b, k, i, &at);
            for (int32_t j = 0; j < m.count; j++)
                k->weight[at + j] = k->demand[at + j] / fmax(b->load[m.vertex[j]] / most, MIN_LOAD);
        }
}

static bool take_bound(bound *b) {
    const tm_smoothed *s = b->tissue->smoothed;
    const tm_material_field field = tm_tissue_field(b->tissue);
    if (!tm_smoothed_build_domains(&field, &b->pool, &b->vertex, &b->edge)) return false;
    tm_smoothed_average_all(&field, &b->vertex);
    tm_smoothed_average_all(&field, &b->edge);
    b->kinds[b->kind_count++].domains = &b->vertex;
    if (s->shear > 0) b->kinds[b->kind_count++].domains = &b->edge;
    if (s->shear < 1 || b->tissue->effects) b->kinds[b->kind_count++].domains = NULL;
    for (kind *k = b->kinds; k < b->kinds + b->kind_count; k++) {
        const int64_t n = k->domains ? k->domains->member_count : 4 * (int64_t)b->tissue->mesh->tet_count;
        k->weight = TM_ALLOC(&b->pool, double, n);
        k->demand = TM_ALLOC(&b->pool, double, n);
    }
    b->load = TM_ALLOC(&b->pool, double, b->tissue->mesh->vertex_count);
    return !b->pool.failed;
}

/* Returns the tetrahedron around a vertex with the shortest step of its own. */
static int32_t stiffest_around(const tm_tissue *tissue, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    double most = 0;
    int32_t worst = -1;
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i];
        const double own = tissue->alive[t] ? tm_element_eigenvalue(tissue, t) : 0;
        if (own > most) most = own, worst = t;
    }
    return worst;
}

bool tm_smoothed_eigenvalue(const tm_tissue *tissue, double *most, int32_t *tet) {
    bound b = {.tissue = tissue};
    const bool room = take_bound(&b);
    for (const kind *k = b.kinds; room && k < b.kinds + b.kind_count; k++) first_weights(&b, k);
    for (int sweep = 0; room && sweep < SWEEPS; sweep++) {
        int32_t vertex = 0;
        const double now = demand_all(&b, &vertex);
        if (now * (1 + 1e-9) < *most) { /* the law's root is accurate to the root of rounding */
            *most = now * (1 + 1e-9);
            *tet = stiffest_around(tissue, vertex);
        }
        follow_loads(&b, now);
    }
    tm_pool_release(&b.pool);
    return room;
}
