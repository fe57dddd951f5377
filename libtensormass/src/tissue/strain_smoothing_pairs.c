/* Assembles the blocks of smoothed tissue. A row, the blocks of one vertex and of its pairs with higher ones, is summed
 * over the vertex's domains, ascending: those of vertices, of edges, then tetrahedra. After a cut, touched rows are
 * summed again in the same order, so that all bits are those of a fresh build. */
#include "tissue/strain_smoothing_pairs.h"

#include <stdlib.h>
#include <string.h>

/* --- building --- */

static bool same_law(const tm_material *a, const tm_material *b) {
    return a->lambda_Pa == b->lambda_Pa && a->mu_Pa == b->mu_Pa && a->dlambda_Pa == b->dlambda_Pa &&
           a->dmu_Pa == b->dmu_Pa && a->beta_Pa == b->beta_Pa && a->law == b->law && a->stretch_max == b->stretch_max &&
           !memcmp(a->law_constant, b->law_constant, sizeof a->law_constant);
}

static const tm_material *material_of(const tm_tissue_def *def, int32_t region) {
    return def->material + (def->region_material ? def->region_material[region] : region);
}

/* Effects of a region, as far as its domains depend on them. */
static int effects_of(const tm_tissue_def *def, int32_t region) {
    return def->region_effects ? def->region_effects[region] & TM_REGION_EFFECTS : TM_REGION_EFFECTS;
}

static void split_laws(tm_smoothed *s, const tm_tissue_def *def) {
    for (int32_t r = 0; r < def->mesh->region_count; r++) {
        s->remainder[r] = *material_of(def, r);
        s->law[r] = -1;
        if (!(effects_of(def, r) & TM_REGION_SMOOTHING)) continue;
        s->bulk_Pa[r] = tm_material_bulk_Pa(s->remainder + r);
        s->law[r] = 0;
        while (effects_of(def, s->law[r]) != effects_of(def, r) ||
               !same_law(material_of(def, s->law[r]), s->remainder + r))
            s->law[r]++;
    }
    for (int32_t r = 0; r < def->mesh->region_count; r++) s->remainder[r].lambda_Pa -= s->bulk_Pa[r];
}

/* Inserts l into the ascending list, unless k has seen it. */
static int32_t insert(int32_t k, int32_t l, int32_t *seen, int32_t *list, int32_t count) {
    if (seen[l] == k + 1) return count;
    seen[l] = k + 1;
    int32_t at = count++;
    for (; at > 0 && list[at - 1] > l; at--) list[at] = list[at - 1];
    list[at] = l;
    return count;
}

/* Lists the higher vertices that share a domain or an edge with k, ascending; `seen` by vertex. */
static int32_t higher_partners(const tm_mesh *mesh, const tm_domains *d, int32_t k, int32_t *seen, int32_t *list) {
    int32_t count = 0;
    for (int32_t i = d->held_at[k]; i < d->held_at[k + 1]; i++)
        for (int32_t m = d->held_as[i] + 1; m < d->member_at[d->held_by[i] + 1]; m++)
            count = insert(k, d->member[m], seen, list, count);
    for (int32_t i = mesh->vertex_edge_begin[k]; i < mesh->vertex_edge_begin[k + 1]; i++) {
        const int32_t l = mesh->edge[2 * (int64_t)mesh->vertex_edge[i] + 1];
        if (l > k) count = insert(k, l, seen, list, count);
    }
    return count;
}

/* Builds pairs, and allocates the longest row. Returns false without memory. */
static bool make_pairs(tm_smoothed_rows *r, const tm_domains *d, const tm_mesh *mesh, tm_pool *pool) {
    tm_pool scratch = {0};
    int32_t *seen = TM_ALLOC(&scratch, int32_t, mesh->vertex_count), most = 0;
    int32_t *list = TM_ALLOC(&scratch, int32_t, mesh->vertex_count);
    for (int32_t k = 0; !scratch.failed && k < mesh->vertex_count; k++) {
        const int32_t n = higher_partners(mesh, d, k, seen, list);
        r->pair_count += n;
        if (n > most) most = n;
    }
    r->pair = TM_ALLOC(pool, int32_t, 2 * (int64_t)r->pair_count);
    r->block = TM_ALLOC(pool, double, 9 * ((int64_t)most + 1));
    r->filled = TM_ALLOC(pool, uint8_t, most + 1);
    const bool good = !scratch.failed && !pool->failed;
    if (good) memset(seen, 0, sizeof *seen * (size_t)mesh->vertex_count);
    for (int32_t k = 0, at = 0; good && k < mesh->vertex_count; k++) {
        const int32_t n = higher_partners(mesh, d, k, seen, list);
        for (int32_t i = 0; i < n; i++, at++) r->pair[2 * (int64_t)at] = k, r->pair[2 * (int64_t)at + 1] = list[i];
    }
    tm_pool_release(&scratch);
    return good;
}

bool tm_smoothed_init(tm_tissue *tissue, const tm_tissue_def *def, tm_pool *pool) {
    const tm_mesh *mesh = def->mesh;
    tm_smoothed *s = tissue->smoothed = TM_ALLOC(pool, tm_smoothed, 1);
    tm_smoothed_rows *r = tissue->rows = TM_ALLOC(pool, tm_smoothed_rows, 1);
    if (pool->failed) return false;
    s->shear = def->smoothed_shear_share;
    s->law = TM_ALLOC(pool, int32_t, mesh->region_count);
    s->bulk_Pa = TM_ALLOC(pool, double, mesh->region_count);
    s->remainder = TM_ALLOC(pool, tm_material, mesh->region_count);
    r->edge_index = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    if (def->cuttable) r->row = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    if (def->cuttable) r->row_waits = TM_ALLOC(pool, uint8_t, mesh->vertex_count);
    if (pool->failed) return false;
    split_laws(s, def);
    tm_pool scratch = {0};
    tm_domains vertex = {0}, edge = {0};
    const tm_material_field field = tm_tissue_field(tissue);
    bool good = tm_smoothed_build_domains(&field, def->cuttable ? pool : &scratch, &vertex, &edge);
    good = good && make_pairs(r, &vertex, mesh, pool);
    if (def->cuttable) s->vertex = vertex, s->edge = edge;
    tm_pool_release(&scratch);
    return good;
}

/* --- one row --- */

static void add_outer(double *K, double factor, const double *a, const double *b) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) K[3 * i + j] += factor * a[i] * b[j];
}

/* Returns the block of (k,l) in the row, k <= l: the vertex's own first, then its pairs. */
static double *block_of(tm_smoothed_rows *r, int32_t k, int32_t l) {
    const int32_t at = l == k ? 0 : r->edge_index[l];
    r->filled[at] = 1;
    return r->block + 9 * (int64_t)at;
}

static void add_volume(const tm_tissue *tissue, const tm_domains *d, int32_t k, int32_t i, int32_t as) {
    const double stiffness = tissue->smoothed->bulk_Pa[d->law[i]] * d->volume_m3[i], *g = d->gradient + 3 * (int64_t)as;
    for (int32_t m = as; m < d->member_at[i + 1]; m++)
        if (d->lives[m]) add_outer(block_of(tissue->rows, k, d->member[m]), stiffness, g, d->gradient + 3 * (int64_t)m);
}

/* Computes B^T C of the gradient g; times another gradient's B it is the block of the two. */
static void stress_of(const double C[36], const double g[3], double P[18]) {
    const double x = g[0], y = g[1], z = g[2];
    for (int J = 0; J < 6; J++) {
        P[J] = x * C[J] + z * C[24 + J] + y * C[30 + J];
        P[6 + J] = y * C[6 + J] + z * C[18 + J] + x * C[30 + J];
        P[12 + J] = z * C[12 + J] + y * C[18 + J] + x * C[24 + J];
    }
}

static void add_stress(double *K, double volume, const double P[18], const double g[3]) {
    const double x = volume * g[0], y = volume * g[1], z = volume * g[2];
    for (int i = 0; i < 3; i++) {
        const double *p = P + 6 * i;
        K[3 * i] += p[0] * x + p[4] * z + p[5] * y;
        K[3 * i + 1] += p[1] * y + p[3] * z + p[5] * x;
        K[3 * i + 2] += p[2] * z + p[3] * y + p[4] * x;
    }
}

static void add_shear(const tm_tissue *tissue, const tm_domains *d, int32_t k, int32_t i, int32_t as) {
    const tm_smoothed *s = tissue->smoothed;
    double C[36], P[18];
    const double *law_Pa = d->law_Pa ? d->law_Pa + 36 * (int64_t)i : C, volume = s->shear * d->volume_m3[i];
    if (!d->law_Pa) tm_material_voigt(s->remainder + d->law[i], NULL, C);
    stress_of(law_Pa, d->gradient + 3 * (int64_t)as, P);
    for (int32_t m = as; m < d->member_at[i + 1]; m++)
        if (d->lives[m]) add_stress(block_of(tissue->rows, k, d->member[m]), volume, P, d->gradient + 3 * (int64_t)m);
}

static void add_tetrahedron(const tm_tissue *tissue, int32_t k, int32_t tet) {
    const tm_smoothed *s = tissue->smoothed;
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)tet;
    const double *alpha = tissue->mesh->shape_1_m + 12 * (int64_t)tet;
    const double share = s->law[tissue->mesh->region[tet]] < 0 ? 1 : 1 - s->shear;
    const double volume = share * tissue->mesh->volume_m3[tet];
    int own = 0;
    while (v[own] != k) own++;
    for (int l = 0; l < 4; l++) {
        if (v[l] < k) continue;
        double K[9], *sum = block_of(tissue->rows, k, v[l]);
        tm_stiffness_block(s->remainder + tissue->mesh->region[tet], tm_tissue_tet_fibre(tissue, tet), volume,
                           alpha + 3 * own, alpha + 3 * l, K);
        for (int i = 0; i < 9; i++) sum[i] += K[i];
    }
}

/* Returns whether the tetrahedra around a vertex are not smoothed: its row is that of other tissue, bit for bit. */
static bool is_plain(const tm_tissue *tissue, int32_t k) {
    const tm_mesh *mesh = tissue->mesh;
    const int32_t first = mesh->vertex_tet_begin[k];
    return first < mesh->vertex_tet_begin[k + 1] && tissue->smoothed->law[mesh->region[mesh->vertex_tet[first]]] < 0;
}

/* Writes the row into the graph: active pairs at the front of the vertex's range. */
static void store_row(tm_tissue *tissue, int32_t k) {
    const tm_smoothed_rows *r = tissue->rows;
    tm_force_graph *g = &tissue->graph;
    const int32_t first = g->upper_begin[k], count = g->upper_begin[k + 1] - first;
    double *own = g->vertex_tensor + 9 * (int64_t)k;
    int32_t slot = first;
    const bool plain = is_plain(tissue, k);
    for (int i = 0; i < 9; i++) own[i] = plain ? r->block[i] : 0.5 * (r->block[i] + r->block[3 * (i % 3) + i / 3]);
    for (int32_t p = 0; p < count; p++) {
        const bool lives = r->filled[1 + p];
        if (tissue->edge_index) tissue->edge_index[first + p] = lives ? slot : -1;
        if (!lives) continue;
        tm_edge_write(g, slot, r->block + 9 * ((int64_t)p + 1));
        g->upper_vertex[slot++] = r->pair[2 * ((int64_t)first + p) + 1];
    }
    g->upper_end[k] = slot;
}

static void assemble_row(tm_tissue *tissue, const tm_domains *vertex, const tm_domains *edge, int32_t k) {
    const tm_smoothed *s = tissue->smoothed;
    tm_smoothed_rows *r = tissue->rows;
    const tm_mesh *mesh = tissue->mesh;
    const int32_t first = tissue->graph.upper_begin[k], count = tissue->graph.upper_begin[k + 1] - first;
    memset(r->block, 0, 9 * sizeof(double) * ((size_t)count + 1));
    memset(r->filled, 0, (size_t)count + 1);
    const bool needs_tets = s->shear < 1 || is_plain(tissue, k);
    for (int32_t p = 0; p < count; p++) r->edge_index[r->pair[2 * ((int64_t)first + p) + 1]] = p + 1;
    for (int32_t i = vertex->held_at[k]; i < vertex->held_at[k + 1]; i++)
        if (vertex->lives[vertex->held_as[i]]) add_volume(tissue, vertex, k, vertex->held_by[i], vertex->held_as[i]);
    for (int32_t i = s->shear > 0 ? edge->held_at[k] : 0; s->shear > 0 && i < edge->held_at[k + 1]; i++)
        if (edge->lives[edge->held_as[i]]) add_shear(tissue, edge, k, edge->held_by[i], edge->held_as[i]);
    for (int32_t i = mesh->vertex_tet_begin[k]; needs_tets && i < mesh->vertex_tet_begin[k + 1]; i++)
        if (tissue->alive[mesh->vertex_tet[i]]) add_tetrahedron(tissue, k, mesh->vertex_tet[i]);
    store_row(tissue, k);
}

/* --- all rows, and those that a cut touched --- */

bool tm_smoothed_assemble(tm_tissue *tissue) {
    tm_smoothed *s = tissue->smoothed;
    const tm_material_field field = tm_tissue_field(tissue);
    tm_pool scratch = {0};
    tm_domains vertex = s->vertex, edge = s->edge;
    const bool good = s->vertex.begin || tm_smoothed_build_domains(&field, &scratch, &vertex, &edge);
    if (good) {
        tm_smoothed_average_all(&field, &vertex);
        tm_smoothed_average_all(&field, &edge);
        for (int32_t k = 0; k < tissue->mesh->vertex_count; k++) assemble_row(tissue, &vertex, &edge, k);
    }
    tm_pool_release(&scratch);
    return good;
}

static void wait_for(tm_smoothed_rows *r, int32_t row) {
    if (!r->row_waits[row]) r->row[r->row_count++] = row;
    r->row_waits[row] = 1;
}

void tm_smoothed_cut(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge, int32_t edges) {
    tm_smoothed *s = tissue->smoothed;
    tm_smoothed_rows *r = tissue->rows;
    const tm_material_field field = tm_tissue_field(tissue);
    for (int32_t i = 0; i < vertices; i++) {
        tm_smoothed_average(&field, &s->vertex, vertex[i]);
        wait_for(r, vertex[i]); /* not smoothed: in no domain */
        /* Members of an edge's domains are members of its ends'. */
        for (int32_t d = s->vertex.begin[vertex[i]]; d < s->vertex.begin[vertex[i] + 1]; d++)
            for (int32_t m = s->vertex.member_at[d]; m < s->vertex.member_at[d + 1]; m++)
                wait_for(r, s->vertex.member[m]);
    }
    for (int32_t i = 0; s->shear > 0 && i < edges; i++) tm_smoothed_average(&field, &s->edge, edge[i]);
    while (r->row_count > 0) {
        const int32_t k = r->row[--r->row_count];
        r->row_waits[k] = 0;
        assemble_row(tissue, &s->vertex, &s->edge, k);
    }
}
