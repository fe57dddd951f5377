/* Assembles blocks of the active tetrahedra on vertices and edges, masses and the surface, in the order of a fresh
 * build. */
#include "tissue/strain_smoothing_pairs.h"

#include <math.h>
#include <string.h>

/* --- one tetrahedron --- */

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

/* Computes the mass and damping of a tetrahedron for each of its vertices. */
static void tet_share(const tm_tissue *tissue, int32_t tet, double share[2]) {
    const tm_material *m = tm_tissue_tet_material(tissue, tet);
    share[0] = m->density_kg_m3 * tissue->mesh->volume_m3[tet] / 4;
    share[1] = m->damping_1_s * share[0];
}

void tm_tissue_keep_blocks(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            if (tissue->vertex_block)
                vertex_stiffness(tissue, mesh->vertex_tet[i], v, tissue->vertex_block + 9 * (int64_t)i);
            tet_share(tissue, mesh->vertex_tet[i], tissue->vertex_share + 2 * (int64_t)i);
        }
    for (int32_t e = 0; tissue->edge_block && e < mesh->edge_count; e++)
        for (int32_t i = mesh->edge_tet_begin[e]; i < mesh->edge_tet_begin[e + 1]; i++)
            edge_stiffness(tissue, mesh->edge_tet[i], e, tissue->edge_block + 9 * (int64_t)i);
}

/* --- edges of the force loop --- */

bool tm_tissue_edge_lives(const tm_tissue *tissue, int32_t edge) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t i = mesh->edge_tet_begin[edge]; i < mesh->edge_tet_begin[edge + 1]; i++)
        if (tissue->alive[mesh->edge_tet[i]]) return true;
    return false;
}

/* Assigns a slot to every active edge. */
static void tm_tissue_place_edges(tm_tissue *tissue) {
    tm_force_graph *g = &tissue->graph;
    for (int32_t k = 0; k < g->vertex_count; k++) {
        int32_t slot = g->upper_begin[k];
        for (int32_t e = g->upper_begin[k]; e < g->upper_begin[k + 1]; e++) {
            const bool lives = !tissue->edge_index || tm_tissue_edge_lives(tissue, e);
            if (tissue->edge_index) tissue->edge_index[e] = lives ? slot : -1;
            if (lives) g->upper_vertex[slot++] = tissue->mesh->edge[2 * (int64_t)e + 1];
        }
        g->upper_end[k] = slot;
    }
}

void tm_tissue_drop_edge(tm_tissue *tissue, int32_t edge) {
    tm_force_graph *g = &tissue->graph;
    const int32_t k = tissue->mesh->edge[2 * (int64_t)edge], slot = tissue->edge_index[edge];
    const int32_t behind = --g->upper_end[k] - slot;
    tm_edge_move(g, slot, slot + 1, behind);
    memmove(g->upper_vertex + slot, g->upper_vertex + slot + 1, sizeof(int32_t) * (size_t)behind);
    for (int32_t e = edge + 1; e < g->upper_begin[k + 1]; e++) tissue->edge_index[e] -= tissue->edge_index[e] >= 0;
    tissue->edge_index[edge] = -1;
}

void tm_tissue_raise_edge(tm_tissue *tissue, int32_t edge) {
    if (tissue->edge_index[edge] >= 0) return;
    tm_force_graph *g = &tissue->graph;
    const int32_t k = tissue->mesh->edge[2 * (int64_t)edge];
    int32_t slot = g->upper_begin[k];
    for (int32_t e = g->upper_begin[k]; e < edge; e++) slot += tissue->edge_index[e] >= 0;
    const int32_t behind = g->upper_end[k]++ - slot;
    tm_edge_move(g, slot + 1, slot, behind);
    memmove(g->upper_vertex + slot + 1, g->upper_vertex + slot, sizeof(int32_t) * (size_t)behind);
    for (int32_t e = edge + 1; e < g->upper_begin[k + 1]; e++) tissue->edge_index[e] += tissue->edge_index[e] >= 0;
    tissue->edge_index[edge] = slot;
    g->upper_vertex[slot] = tissue->mesh->edge[2 * (int64_t)edge + 1];
}

/* --- sums --- */

static void add9(double *TM_RESTRICT sum, const double *TM_RESTRICT K) {
    for (int i = 0; i < 9; i++) sum[i] += K[i];
}

/* In single precision, rounded edge tensors do not add up to the vertex tensor, and the rest would resist a
 * translation: a slender beam is off by a thousandth. So the vertex tensor is minus the sum of its edges as stored,
 * made symmetric, and kept in double. */
static void balance_edges(const tm_tissue *tissue, int32_t vertex, double sum[9]) {
    const tm_mesh *mesh = tissue->mesh;
    double S[9] = {0};
    for (int32_t i = mesh->vertex_edge_begin[vertex]; i < mesh->vertex_edge_begin[vertex + 1]; i++) {
        const int32_t edge = mesh->vertex_edge[i], slot = tm_tissue_edge_index(tissue, edge);
        if (slot < 0) continue;
        double K[9];
        tm_edge_read(&tissue->graph, slot, K);
        const bool upper = mesh->edge[2 * edge] == vertex;
        for (int k = 0; k < 9; k++) S[k] -= K[upper ? k : 3 * (k % 3) + k / 3];
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

/* Returns the mass that mass scaling requires at a vertex. */
static double demand_of(const tm_tissue *tissue, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    double sum = 0;
    for (int32_t i = mesh->vertex_tet_begin[vertex]; i < mesh->vertex_tet_begin[vertex + 1]; i++)
        if (tissue->alive[mesh->vertex_tet[i]]) sum += tissue->required_mass_kg[i];
    return sum;
}

/* Assembles a vertex, after its edges. */
static void tm_tissue_assemble_vertex(tm_tissue *tissue, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    double *sum = tissue->graph.vertex_tensor + 9 * (int64_t)vertex;
    double mass = tissue->extra_mass_kg ? tissue->extra_mass_kg[vertex] : 0;
    double damping = tissue->extra_damping_kg_s ? tissue->extra_damping_kg_s[vertex] : 0;
    if (tissue->precision == TM_SINGLE)
        balance_edges(tissue, vertex, sum);
    else if (!tissue->smoothed)
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
    tissue->mass_kg[vertex] = tissue->physical_mass_kg[vertex] = mass;
    if (tissue->required_mass_kg) tissue->mass_kg[vertex] = fmax(mass, demand_of(tissue, vertex));
    tissue->damping_kg_s[vertex] = damping;
    const uint64_t bit = UINT64_C(1) << (vertex % 64);
    uint64_t *active = tissue->graph.active + vertex / 64;
    *active = mass > 0 || damping > 0 ? *active | bit : *active & ~bit;
}

void tm_tissue_assemble_edge(tm_tissue *tissue, int32_t edge) {
    const tm_mesh *mesh = tissue->mesh;
    const int32_t slot = tm_tissue_edge_index(tissue, edge);
    if (slot < 0) return;
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
    tm_edge_write(&tissue->graph, slot, sum);
}

bool tm_tissue_assemble(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    if (tissue->smoothed) {
        if (!tm_smoothed_assemble(tissue)) return false;
    } else {
        tm_tissue_place_edges(tissue);
        for (int32_t e = 0; e < mesh->edge_count; e++) tm_tissue_assemble_edge(tissue, e);
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) tm_tissue_assemble_vertex(tissue, v);
    return true;
}

void tm_tissue_assemble_touched(tm_tissue *tissue, const int32_t *vertex, int32_t vertices, const int32_t *edge,
                                int32_t edges) {
    if (tissue->smoothed) tm_smoothed_cut(tissue, vertex, vertices, edge, edges);
    for (int32_t i = 0; !tissue->smoothed && i < edges; i++) tm_tissue_assemble_edge(tissue, edge[i]);
    for (int32_t i = 0; i < vertices; i++) tm_tissue_assemble_vertex(tissue, vertex[i]);
}

/* --- surface --- */

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
