/* Random vertices and tetrahedra: the library rejects exactly the meshes in which the loader's check finds a defect.
 * Accepted ones have positive volumes and mutual neighbours, and a step stays finite. */
#include <math.h>

#include "fuzz.h"
#include "tensormass_io.h"

enum { MAX_VERTICES = 12, MAX_TETS = 16 };

static void look_over(const tm_mesh *mesh) {
    for (int32_t t = 0; t < mesh->tet_count; t++) PROMISE(mesh->volume_m3[t] > 0);
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
        int32_t other = mesh->tet_neighbour[f];
        bool mutual = other < 0;
        for (int i = 0; other >= 0 && i < 4; i++) mutual = mutual || mesh->tet_neighbour[4 * other + i] == f / 4;
        PROMISE(mutual);
    }
}

static void step(const tm_mesh *mesh) {
    tm_material material;
    tm_tissue *tissue = NULL;
    tm_world *world = NULL;
    PROMISE(tm_material_young(5000, 0.4, &material, NULL) == TM_OK);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh;
    def.material_count = 1;
    def.material = &material;
    def.form = TM_FORCE_PLAIN;
    if (tm_tissue_create(&def, &tissue, NULL) != TM_OK) return;
    tm_world_def world_def = tm_world_def_default();
    world_def.tissue = tissue;
    if (tm_world_create(&world_def, &world, NULL) == TM_OK) {
        tm_state *state = tm_world_state(world);
        PROMISE(tm_world_step(world, 5) == TM_OK);
        for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) PROMISE(state->u_m[i] == 0);
        tm_world_destroy(world);
    }
    tm_tissue_destroy(tissue);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    tm_mesh_file m = {.vertex_count = 4 + fuzz_u8(&b) % (MAX_VERTICES - 3),
                      .tet_count = 1 + fuzz_u8(&b) % MAX_TETS,
                      .region_count = 1};
    bool raw = fuzz_u8(&b) & 1;
    PROMISE(tm_mesh_file_allocate(&m, 0));
    for (int32_t t = 0; t < m.tet_count; t++) {
        m.tet_tag[t] = t + 1;
        for (int k = 0; k < 4; k++) m.tet[4 * t + k] = fuzz_u8(&b) % m.vertex_count;
    }
    for (int32_t v = 0; v < m.vertex_count; v++) {
        m.vertex_tag[v] = v + 1;
        for (int k = 0; k < 3; k++) {
            if (raw)
                fuzz_take(&b, &m.vertex_m[3 * v + k], sizeof(double));
            else
                m.vertex_m[3 * v + k] = 1e-3 * (int8_t)fuzz_u8(&b);
        }
    }
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    int64_t before = tm_memory_in_use(), defects = tm_mesh_file_defects(&m, NULL, 0);
    tm_status status = tm_mesh_file_build(&m, &mesh, &error);
    if (!raw) PROMISE((status == TM_OK) == (defects == 0));
    PROMISE(status == TM_OK || (mesh == NULL && error.message[0]));
    if (mesh) {
        look_over(mesh);
        if (!raw) step(mesh);
    }
    tm_mesh_destroy(mesh);
    tm_mesh_file_free(&m);
    PROMISE(tm_memory_in_use() == before);
    return 0;
}
