/* Tissue: blocks of the living tetrahedra summed on vertices and edges, masses, the surface. */
#include "cut/cut_internal.h"

#include <math.h>
#include <string.h>

tm_tissue_def tm_tissue_def_default(void) {
    return (tm_tissue_def){.cookie = TM_COOKIE_TISSUE, .size = sizeof(tm_tissue_def)};
}

void tm_tissue_destroy(tm_tissue *tissue) {
    if (!tissue) return;
    tm_pool pool = tissue->pool;
    tm_pool_release(&pool);
}

/* --- assembly --- */

static void stiffness(const tm_tissue *tissue, int32_t tet, int local_k, int local_l, double K[9]) {
    const double *alpha = tissue->mesh->shape_1_m + 12 * (int64_t)tet;
    tm_stiffness_block(tm_tissue_tet_material(tissue, tet), tm_tissue_tet_fibre(tissue, tet),
                       tissue->mesh->volume_m3[tet], alpha + 3 * local_k, alpha + 3 * local_l, K);
}

static void vertex_stiffness(const tm_tissue *tissue, int32_t tet, int32_t vertex, double K[9]) {
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)tet;
    int local = 0;
    while (v[local] != vertex) local++;
    stiffness(tissue, tet, local, local, K);
}

/* Edge blocks point from the lower to the higher vertex, as edge tensors do. */
static void edge_stiffness(const tm_tissue *tissue, int32_t tet, int32_t edge, double K[9]) {
    const int32_t *v = tissue->mesh->tet + 4 * (int64_t)tet, *ends = tissue->mesh->edge + 2 * (int64_t)edge;
    int k = 0, l = 0;
    while (v[k] != ends[0]) k++;
    while (v[l] != ends[1]) l++;
    stiffness(tissue, tet, k, l, K);
}

/* Mass, and damping, that a tetrahedron gives to each of its vertices. */
static void tet_share(const tm_tissue *tissue, int32_t tet, double share[2]) {
    const tm_material *m = tm_tissue_tet_material(tissue, tet);
    share[0] = m->density_kg_m3 * tissue->mesh->volume_m3[tet] / 4;
    share[1] = m->damping_1_s * share[0];
}

static void keep_blocks(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            if (tissue->vertex_block)
                vertex_stiffness(tissue, mesh->vertex_tet[i], v, tissue->vertex_block + 9 * (int64_t)i);
            tet_share(tissue, mesh->vertex_tet[i], tissue->vertex_share + 2 * (int64_t)i);
        }
    for (int32_t e = 0; e < mesh->edge_count; e++)
        for (int32_t i = mesh->edge_tet_begin[e]; i < mesh->edge_tet_begin[e + 1]; i++)
            edge_stiffness(tissue, mesh->edge_tet[i], e, tissue->edge_block + 9 * (int64_t)i);
}

/* --- edges of the force loop --- */

static int32_t slot_of(const tm_tissue *tissue, int32_t edge) {
    return tissue->edge_slot ? tissue->edge_slot[edge] : edge;
}

bool tm_tissue_edge_lives(const tm_tissue *tissue, int32_t edge) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t i = mesh->edge_tet_begin[edge]; i < mesh->edge_tet_begin[edge + 1]; i++)
        if (tissue->alive[mesh->edge_tet[i]]) return true;
    return false;
}

void tm_tissue_place_edges(tm_tissue *tissue) {
    tm_force_graph *g = &tissue->graph;
    for (int32_t k = 0; k < g->vertex_count; k++) {
        int32_t slot = g->upper_begin[k];
        for (int32_t e = g->upper_begin[k]; e < g->upper_begin[k + 1]; e++) {
            const bool lives = !tissue->edge_slot || tm_tissue_edge_lives(tissue, e);
            if (tissue->edge_slot) tissue->edge_slot[e] = lives ? slot : -1;
            if (lives) g->upper_vertex[slot++] = tissue->mesh->edge[2 * (int64_t)e + 1];
        }
        g->upper_end[k] = slot;
    }
}

void tm_tissue_drop_edge(tm_tissue *tissue, int32_t edge) {
    tm_force_graph *g = &tissue->graph;
    const int32_t k = tissue->mesh->edge[2 * (int64_t)edge], slot = tissue->edge_slot[edge];
    const size_t block = 9 * (tissue->precision == TM_SINGLE ? sizeof(float) : sizeof(double)),
                 behind = (size_t)(--g->upper_end[k] - slot);
    char *tensor = (char *)g->edge_tensor + block * (size_t)slot;
    memmove(tensor, tensor + block, block * behind);
    memmove(g->upper_vertex + slot, g->upper_vertex + slot + 1, sizeof(int32_t) * behind);
    for (int32_t e = edge + 1; e < g->upper_begin[k + 1]; e++) tissue->edge_slot[e] -= tissue->edge_slot[e] >= 0;
    tissue->edge_slot[edge] = -1;
}

void tm_tissue_raise_edge(tm_tissue *tissue, int32_t edge) {
    if (tissue->edge_slot[edge] >= 0) return;
    tm_force_graph *g = &tissue->graph;
    const int32_t k = tissue->mesh->edge[2 * (int64_t)edge];
    int32_t slot = g->upper_begin[k];
    for (int32_t e = g->upper_begin[k]; e < edge; e++) slot += tissue->edge_slot[e] >= 0;
    const size_t block = 9 * (tissue->precision == TM_SINGLE ? sizeof(float) : sizeof(double)),
                 behind = (size_t)(g->upper_end[k]++ - slot);
    char *tensor = (char *)g->edge_tensor + block * (size_t)slot;
    memmove(tensor + block, tensor, block * behind);
    memmove(g->upper_vertex + slot + 1, g->upper_vertex + slot, sizeof(int32_t) * behind);
    for (int32_t e = edge + 1; e < g->upper_begin[k + 1]; e++) tissue->edge_slot[e] += tissue->edge_slot[e] >= 0;
    tissue->edge_slot[edge] = slot;
    g->upper_vertex[slot] = tissue->mesh->edge[2 * (int64_t)edge + 1];
}

/* --- sums --- */

static void add9(double *TM_RESTRICT sum, const double *TM_RESTRICT K) {
    for (int i = 0; i < 9; i++) sum[i] += K[i];
}

/* Single edge tensors do not add up to the vertex tensor by rounding, and the rest would resist a translation: a
 * slender beam of them is off by a thousandth. So in single the vertex tensor is minus the sum of its edges as stored,
 * made symmetric, and kept in double. */
static void balance_edges(const tm_tissue *tissue, int32_t vertex, double sum[9]) {
    const tm_mesh *mesh = tissue->mesh;
    double S[9] = {0};
    for (int32_t i = mesh->vertex_edge_begin[vertex]; i < mesh->vertex_edge_begin[vertex + 1]; i++) {
        const int32_t edge = mesh->vertex_edge[i], slot = slot_of(tissue, edge);
        if (slot < 0) continue;
        const float *K = (const float *)tissue->graph.edge_tensor + 9 * (int64_t)slot;
        const bool upper = mesh->edge[2 * edge] == vertex;
        for (int k = 0; k < 9; k++) S[k] -= (double)K[upper ? k : 3 * (k % 3) + k / 3];
    }
    for (int k = 0; k < 9; k++) sum[k] = (S[k] + S[3 * (k % 3) + k / 3]) / 2;
}

static void sum_blocks(const tm_tissue *tissue, int32_t vertex, double sum[9]) {
    const tm_mesh *mesh = tissue->mesh;
    memset(sum, 0, 9 * sizeof(double));
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i];
        if (!tissue->alive[t]) continue;
        double K[9];
        const double *block = K;
        if (tissue->vertex_block)
            block = tissue->vertex_block + 9 * (int64_t)i;
        else
            vertex_stiffness(tissue, t, vertex, K);
        add9(sum, block);
    }
}

void tm_tissue_assemble_vertex(tm_tissue *tissue, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    double *sum = tissue->graph.vertex_tensor + 9 * (int64_t)vertex;
    double mass = tissue->extra_mass_kg ? tissue->extra_mass_kg[vertex] : 0;
    double damping = tissue->extra_damping_kg_s ? tissue->extra_damping_kg_s[vertex] : 0;
    if (tissue->precision == TM_SINGLE)
        balance_edges(tissue, vertex, sum);
    else
        sum_blocks(tissue, vertex, sum);
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++) {
        const int32_t t = mesh->vertex_tet[i];
        if (!tissue->alive[t]) continue;
        double S[2];
        const double *share = S;
        if (tissue->vertex_share)
            share = tissue->vertex_share + 2 * (int64_t)i;
        else
            tet_share(tissue, t, S);
        mass += share[0];
        damping += share[1];
    }
    tissue->mass_kg[vertex] = mass;
    tissue->damping_kg_s[vertex] = damping;
    const uint64_t bit = UINT64_C(1) << (vertex % 64);
    uint64_t *living = tissue->graph.living + vertex / 64;
    *living = mass > 0 || damping > 0 ? *living | bit : *living & ~bit;
}

void tm_tissue_assemble_edge(tm_tissue *tissue, int32_t edge) {
    const tm_mesh *mesh = tissue->mesh;
    const int64_t at = 9 * (int64_t)slot_of(tissue, edge);
    if (at < 0) return;
    double sum[9] = {0};
    for (int32_t i = mesh->edge_tet_begin[edge]; i < mesh->edge_tet_begin[edge + 1]; i++) {
        const int32_t t = mesh->edge_tet[i];
        if (!tissue->alive[t]) continue;
        double K[9];
        const double *block = K;
        if (tissue->edge_block)
            block = tissue->edge_block + 9 * (int64_t)i;
        else
            edge_stiffness(tissue, t, edge, K);
        add9(sum, block);
    }
    if (tissue->precision == TM_SINGLE)
        for (int i = 0; i < 9; i++) ((float *)tissue->graph.edge_tensor)[at + i] = (float)sum[i];
    else
        memcpy((double *)tissue->graph.edge_tensor + at, sum, sizeof sum);
}

/* --- building --- */

static tm_status check_extra(const tm_mesh *mesh, const double *extra, const char *what, tm_error *error) {
    for (int32_t v = 0; extra && v < mesh->vertex_count; v++)
        if (!(extra[v] >= 0) || !isfinite(extra[v]))
            return tm_fail(error, TM_ERR_ARGUMENT, v, "vertex %d: extra %s of %g; give 0 or more", v, what, extra[v]);
    return TM_OK;
}

static tm_status check_regions(const tm_tissue_def *def, tm_error *error) {
    if ((def->precision != TM_DOUBLE && def->precision != TM_SINGLE) ||
        (def->form != TM_FORCE_BEST && def->form != TM_FORCE_PLAIN))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "precision %d, form %d; give one of tm_precision, one of tm_force_form", (int)def->precision,
                       (int)def->form);
    if (def->material_count < 1 || !def->material)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "no material; give at least one");
    for (int32_t i = 0; i < def->material_count; i++) {
        const tm_status status = tm_material_check(def->material + i, error);
        if (status) {
            if (error) error->entity = i;
            return status;
        }
    }
    for (int32_t r = 0; r < def->mesh->region_count; r++) {
        const int32_t m = def->region_material ? def->region_material[r] : r;
        if (m < 0 || m >= def->material_count)
            return tm_fail(error, TM_ERR_ARGUMENT, r, "region %d: has material %d of %d; give every region a material",
                           r, m, def->material_count);
    }
    return TM_OK;
}

static tm_status check_fibres(const tm_tissue_def *def, tm_error *error) {
    for (int32_t t = 0; t < def->mesh->tet_count; t++) {
        const int32_t r = def->mesh->region[t];
        const tm_material *m = def->material + (def->region_material ? def->region_material[r] : r);
        if (tm_material_is_isotropic(m)) continue;
        if (!def->fibre)
            return tm_fail(error, TM_ERR_ARGUMENT, t,
                           "tetrahedron %d: region %d is anisotropic and there are no fibres; give a "
                           "direction for each tetrahedron",
                           t, r);
        const double length = sqrt(tm_dot3(def->fibre + 3 * (int64_t)t, def->fibre + 3 * (int64_t)t));
        if (!(fabs(length - 1) <= 1e-3))
            return tm_fail(
                error, TM_ERR_ARGUMENT, t, "tetrahedron %d: its fibre (%g %g %g) has length %g; give unit vectors", t,
                def->fibre[3 * (int64_t)t], def->fibre[3 * (int64_t)t + 1], def->fibre[3 * (int64_t)t + 2], length);
    }
    return TM_OK;
}

static bool any_anisotropic(const tm_tissue_def *def) {
    for (int32_t i = 0; i < def->material_count; i++)
        if (!tm_material_is_isotropic(def->material + i)) return true;
    return false;
}

static void take_graph(tm_force_graph *graph, tm_pool *pool, const tm_mesh *mesh, tm_precision precision) {
    graph->vertex_count = mesh->vertex_count;
    graph->living = TM_TAKE(pool, uint64_t, mesh->vertex_count / 64 + 1);
    graph->upper_begin = TM_TAKE(pool, int32_t, (int64_t)mesh->vertex_count + 1);
    graph->upper_end = TM_TAKE(pool, int32_t, mesh->vertex_count);
    graph->upper_vertex = TM_TAKE(pool, int32_t, mesh->edge_count);
    graph->vertex_tensor = TM_TAKE(pool, double, 9 * (int64_t)mesh->vertex_count + TM_FORCE_PADDING);
    graph->edge_tensor = tm_pool_take(pool, 9 * (int64_t)mesh->edge_count + TM_FORCE_PADDING,
                                      precision == TM_SINGLE ? sizeof(float) : sizeof(double));
}

static void take(tm_tissue *tissue, tm_pool *pool, const tm_tissue_def *def) {
    const tm_mesh *mesh = def->mesh;
    tissue->material = TM_TAKE(pool, tm_material, def->material_count);
    tissue->region_material = TM_TAKE(pool, int32_t, mesh->region_count);
    if (def->fibre && any_anisotropic(def)) tissue->fibre = TM_TAKE(pool, double, 3 * (int64_t)mesh->tet_count);
    tissue->alive = TM_TAKE(pool, uint8_t, mesh->tet_count);
    tissue->mass_kg = TM_TAKE(pool, double, mesh->vertex_count);
    tissue->damping_kg_s = TM_TAKE(pool, double, mesh->vertex_count);
    if (def->elsewhere) tissue->elsewhere = TM_TAKE(pool, uint8_t, mesh->tet_count);
    if (def->extra_mass_kg) tissue->extra_mass_kg = TM_TAKE(pool, double, mesh->vertex_count);
    if (def->extra_damping_kg_s) tissue->extra_damping_kg_s = TM_TAKE(pool, double, mesh->vertex_count);
    take_graph(&tissue->graph, pool, mesh, def->precision);
    if (def->cuttable || def->alive) tissue->edge_slot = TM_TAKE(pool, int32_t, mesh->edge_count);
    if (def->cuttable) {
        if (def->precision == TM_DOUBLE) tissue->vertex_block = TM_TAKE(pool, double, 36 * (int64_t)mesh->tet_count);
        tissue->edge_block = TM_TAKE(pool, double, 54 * (int64_t)mesh->tet_count);
        tissue->vertex_share = TM_TAKE(pool, double, 8 * (int64_t)mesh->tet_count);
        tissue->face_slot = TM_TAKE(pool, int32_t, 4 * (int64_t)mesh->tet_count);
        tissue->cut = tm_cut_take_work(pool, mesh);
    }
    if (def->cuttable || def->alive) {
        /* Every face of the mesh, once: no subset has a larger surface. */
        const int64_t faces = (4 * (int64_t)mesh->tet_count + mesh->surface_count) / 2;
        tissue->surface_triangle = TM_TAKE(pool, int32_t, 3 * faces);
        tissue->surface_face = TM_TAKE(pool, int32_t, faces);
    }
}

static void copy_constants(tm_tissue *tissue, const tm_tissue_def *def) {
    const tm_mesh *mesh = def->mesh;
    tissue->mesh = mesh;
    tissue->material_count = def->material_count;
    tissue->precision = def->precision;
    tissue->cuttable = def->cuttable;
    tissue->force = tm_force_choose(def->form == TM_FORCE_PLAIN, def->precision == TM_SINGLE);
    if (def->extra_mass_kg)
        memcpy(tissue->extra_mass_kg, def->extra_mass_kg, sizeof(double) * (size_t)mesh->vertex_count);
    if (def->extra_damping_kg_s)
        memcpy(tissue->extra_damping_kg_s, def->extra_damping_kg_s, sizeof(double) * (size_t)mesh->vertex_count);
    memcpy(tissue->material, def->material, sizeof(tm_material) * (size_t)def->material_count);
    for (int32_t r = 0; r < mesh->region_count; r++)
        tissue->region_material[r] = def->region_material ? def->region_material[r] : r;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        tissue->alive[t] = !def->alive || def->alive[t];
        tissue->alive_count += tissue->alive[t];
        if (def->elsewhere) tissue->elsewhere[t] = def->elsewhere[t] && !tissue->alive[t];
        if (!tissue->fibre) continue;
        const double *a = def->fibre + 3 * (int64_t)t;
        const double length = sqrt(tm_dot3(a, a));
        for (int i = 0; i < 3; i++)
            tissue->fibre[3 * (int64_t)t + i] = length > 0 && isfinite(length) ? a[i] / length : 0;
    }
    for (int32_t e = 0; e < mesh->edge_count; e++) tissue->graph.upper_begin[mesh->edge[2 * e] + 1]++;
    for (int32_t v = 0; v < mesh->vertex_count; v++) tissue->graph.upper_begin[v + 1] += tissue->graph.upper_begin[v];
}

void tm_tissue_build_surface(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    if (!tissue->surface_triangle) {
        tissue->surface =
            (tm_surface_view){mesh->surface_count, mesh->surface, mesh->surface_face, tissue->surface.revision};
        return;
    }
    int32_t n = 0;
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
        const int32_t neighbour = mesh->tet_neighbour[f];
        const bool outer = tissue->alive[f / 4] && (neighbour < 0 || !tissue->alive[neighbour]);
        if (tissue->face_slot) tissue->face_slot[f] = outer ? n : -1;
        if (!outer) continue;
        for (int i = 0; i < 3; i++)
            tissue->surface_triangle[3 * n + i] = mesh->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][i]];
        tissue->surface_face[n++] = f;
    }
    tissue->surface = (tm_surface_view){n, tissue->surface_triangle, tissue->surface_face, tissue->surface.revision};
}

tm_status tm_tissue_create(const tm_tissue_def *def, tm_tissue **tissue, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_TISSUE, TM_ERR_ARGUMENT);
    TM_REQUIRE(tissue && def->mesh, "tissue or def->mesh is null", TM_ERR_ARGUMENT);
    tm_status status = check_regions(def, error);
    if (!status) status = check_fibres(def, error);
    if (!status) status = check_extra(def->mesh, def->extra_mass_kg, "mass", error);
    if (!status) status = check_extra(def->mesh, def->extra_damping_kg_s, "damping", error);
    if (status) return status;

    tm_pool pool = {0};
    tm_tissue *t = TM_TAKE(&pool, tm_tissue, 1);
    if (t) take(t, &pool, def);
    if (pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "tissue");
    }
    copy_constants(t, def);
    if (t->cuttable) keep_blocks(t);
    tm_tissue_place_edges(t);
    for (int32_t e = 0; e < def->mesh->edge_count; e++) tm_tissue_assemble_edge(t, e);
    for (int32_t v = 0; v < def->mesh->vertex_count; v++) tm_tissue_assemble_vertex(t, v);
    tm_tissue_build_surface(t);
    if (t->cut) tm_cut_count(t);
    t->pool = pool;
    *tissue = t;
    return TM_OK;
}

/* --- views --- */

#define TISSUE_IS_GIVEN(...) TM_REQUIRE(tissue, "tissue is null", __VA_ARGS__)

const tm_mesh *tm_tissue_mesh(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->mesh;
}
const double *tm_tissue_mass_kg(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->mass_kg;
}
const double *tm_tissue_damping_kg_s(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->damping_kg_s;
}
const uint8_t *tm_tissue_alive(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->alive;
}
int32_t tm_tissue_alive_count(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(0);
    return tissue->alive_count;
}
int64_t tm_tissue_bytes(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(0);
    return tissue->pool.bytes;
}
tm_surface_view tm_tissue_surface(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN((tm_surface_view){0});
    return tissue->surface;
}

#define TET_IS_THERE(result)                                                                                           \
    TM_REQUIRE(tissue &&tet >= 0 && tet < tissue->mesh->tet_count,                                                     \
               "tissue is null or tet is not one of its tetrahedra", result)

const tm_material *tm_tissue_tet_material(const tm_tissue *tissue, int32_t tet) {
    TET_IS_THERE(NULL);
    return tissue->material + tissue->region_material[tissue->mesh->region[tet]];
}

const double *tm_tissue_tet_fibre(const tm_tissue *tissue, int32_t tet) {
    TET_IS_THERE(NULL);
    return tissue->fibre ? tissue->fibre + 3 * (int64_t)tet : NULL;
}

void tm_tissue_vertex_tensor(const tm_tissue *tissue, int32_t vertex, double K[9]) {
    TM_REQUIRE(tissue && K && vertex >= 0 && vertex < tissue->mesh->vertex_count,
               "tissue or K is null, or vertex is not one of its vertices", );
    memcpy(K, tissue->graph.vertex_tensor + 9 * (int64_t)vertex, 9 * sizeof(double));
}

void tm_tissue_edge_tensor(const tm_tissue *tissue, int32_t edge, double K[9]) {
    TM_REQUIRE(tissue && K && edge >= 0 && edge < tissue->mesh->edge_count,
               "tissue or K is null, or edge is not one of its edges", );
    const int64_t at = 9 * (int64_t)slot_of(tissue, edge);
    for (int i = 0; i < 9; i++)
        K[i] = at < 0                           ? 0
               : tissue->precision == TM_SINGLE ? (double)((const float *)tissue->graph.edge_tensor)[at + i]
                                                : ((const double *)tissue->graph.edge_tensor)[at + i];
}

void tm_tissue_force(const tm_tissue *tissue, const double *u_m, double *force_N) {
    tissue->force(&tissue->graph, u_m, force_N);
}

static double form(const double K[9], const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < 3; i++) sum += a[i] * tm_dot3(K + 3 * i, b);
    return sum;
}

double tm_tissue_energy(const tm_tissue *tissue, const double *u_m) {
    TM_REQUIRE(tissue && u_m, "tissue or u_m is null", 0);
    const tm_mesh *mesh = tissue->mesh;
    double sum = 0, K[9];
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(tissue, v, K);
        sum += 0.5 * form(K, u_m + 3 * (int64_t)v, u_m + 3 * (int64_t)v);
    }
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        tm_tissue_edge_tensor(tissue, e, K);
        sum += form(K, u_m + 3 * (int64_t)mesh->edge[2 * e], u_m + 3 * (int64_t)mesh->edge[2 * e + 1]);
    }
    return sum;
}
