/* A program outside the tree, as in the library guide: a block under gravity. Also compiled as C++. */
#include <stdio.h>
#include <stdlib.h>
#include <tensormass.h>

static long taken;
static int in_step;

static void *take(size_t bytes, void *user) {
    (void)user;
    if (in_step) abort(); /* the step must not allocate */
    taken += (long)bytes;
    return aligned_alloc(64, (bytes + 63) / 64 * 64);
}

static void give(void *memory, size_t bytes, void *user) {
    (void)user;
    taken -= (long)bytes;
    free(memory);
}

int main(void) {
    tm_allocator hook = {take, give, NULL};
    tm_set_allocator(&hook);
    /* one cube of five tetrahedra */
    static const double vertex[24] = {0, 0, 0,    1e-2, 0, 0,    0, 1e-2, 0,    1e-2, 1e-2, 0,
                                      0, 0, 1e-2, 1e-2, 0, 1e-2, 0, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2};
    static const int32_t tet[20] = {0, 1, 2, 4, 1, 3, 2, 7, 1, 5, 7, 4, 2, 7, 6, 4, 1, 2, 4, 7};
    tm_error error;
    tm_mesh_def mesh_def = tm_mesh_def_default();
    mesh_def.vertex_count = 8, mesh_def.vertex_m = vertex, mesh_def.tet_count = 5, mesh_def.tet = tet;
    tm_mesh *mesh = NULL;
    if (tm_mesh_create(&mesh_def, &mesh, &error) != TM_OK) return fprintf(stderr, "%s\n", error.message), 1;
    tm_material material;
    if (tm_material_young(5e3, 0.45, &material, &error) != TM_OK) return 1;
    material.damping_1_s = 20;
    tm_tissue_def tissue_def = tm_tissue_def_default();
    tissue_def.mesh = mesh, tissue_def.material_count = 1, tissue_def.material = &material;
    tm_tissue *tissue = NULL;
    if (tm_tissue_create(&tissue_def, &tissue, &error) != TM_OK) return 1;
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = tissue;
    tm_world *world = NULL;
    if (tm_world_create(&world_def, &world, &error) != TM_OK) return 1;
    static const int32_t dof[12] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    static const double zero[12] = {0};
    tm_support_def support = tm_support_def_default();
    support.count = 12, support.dof = dof, support.value_m = zero;
    static const double g[3] = {0, 0, -9.81};
    if (tm_stage_support(world, &support, &error) != TM_OK || tm_stage_gravity(world, g, &error) != TM_OK) return 1;
    in_step = 1;
    if (tm_world_step(world, 5000) != TM_OK) return 1;
    in_step = 0;
    double sag = tm_world_state(world)->u_m[3 * 7 + 2];
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    printf("%.9e %ld\n", sag, taken);
    return 0;
}
