/* Read access to a tissue: its mesh and materials, tensors, force and energy. */
#include "tissue/strain_smoothing_pairs.h"

#include <string.h>

#define TISSUE_IS_GIVEN(...) TM_REQUIRE(tissue, "tissue is null", __VA_ARGS__)

const tm_mesh *tm_tissue_mesh(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->mesh;
}
const double *tm_tissue_physical_mass_kg(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(NULL);
    return tissue->physical_mass_kg;
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

int32_t tm_tissue_find_pair(const tm_tissue *tissue, int32_t k, int32_t l) {
    int32_t low = tissue->graph.upper_begin[k], high = tissue->graph.upper_begin[k + 1];
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (tissue->pair[2 * (int64_t)middle + 1] < l)
            low = middle + 1;
        else
            high = middle;
    }
    return low < tissue->graph.upper_begin[k + 1] && tissue->pair[2 * (int64_t)low + 1] == l ? low : -1;
}

void tm_tissue_edge_tensor(const tm_tissue *tissue, int32_t edge, double K[9]) {
    TM_REQUIRE(tissue && K && edge >= 0 && edge < tissue->mesh->edge_count,
               "tissue or K is null, or edge is not one of its edges", );
    const int32_t *ends = tissue->mesh->edge + 2 * (int64_t)edge;
    tm_tissue_pair_tensor(tissue, tissue->smoothed ? tm_tissue_find_pair(tissue, ends[0], ends[1]) : edge, K);
}

tm_pair_view tm_tissue_pairs(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN((tm_pair_view){0});
    return (tm_pair_view){tissue->pair_count, tissue->graph.upper_begin, tissue->pair};
}

double tm_tissue_smoothed_shear_share(const tm_tissue *tissue) {
    TISSUE_IS_GIVEN(-1);
    return tissue->smoothed ? tissue->smoothed->shear : -1;
}

void tm_tissue_pair_tensor(const tm_tissue *tissue, int32_t pair, double K[9]) {
    TM_REQUIRE(tissue && K && pair >= 0 && pair < tissue->pair_count,
               "tissue or K is null, or pair is not one of its pairs", );
    const int32_t slot = tm_tissue_edge_index(tissue, pair);
    if (slot < 0)
        memset(K, 0, 9 * sizeof *K);
    else
        tm_edge_read(&tissue->graph, slot, K);
}

void tm_tissue_force(const tm_tissue *tissue, const double *u_m, double *force_N) {
    tm_force_pass(tissue->force, &tissue->graph, u_m, force_N);
}

static double form(const double K[9], const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < 3; i++) sum += a[i] * vdot(K + 3 * i, b);
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
    for (int32_t p = 0; p < tissue->pair_count; p++) {
        const int32_t *ends = tissue->pair + 2 * (int64_t)p;
        tm_tissue_pair_tensor(tissue, p, K);
        sum += form(K, u_m + 3 * (int64_t)ends[0], u_m + 3 * (int64_t)ends[1]);
    }
    return sum;
}

const uint8_t *tm_tissue_region_effects(const tm_tissue *tissue) {
    TM_REQUIRE(tissue, "tissue is null", NULL);
    return tissue->effects;
}
