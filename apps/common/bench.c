#include <stdlib.h>
#include <string.h>

#include "bench.h"
#include "block.h"

app_bench_def app_bench_default(int32_t cells, double size_m) {
    const tm_tissue_def tissue = tm_tissue_def_default();
    app_bench_def def = {.cells = {cells, cells, cells},
                         .size_m = {size_m, size_m, size_m},
                         .material_count = 1,
                         .step_fraction = tm_world_def_default().step_fraction,
                         .scaled_share = tissue.scaled_share,
                         .smoothed_shear_share = tissue.smoothed_shear_share,
                         .held = APP_HELD_BOTTOM};
    if (tm_material_young(5e3, 0.45, &def.material[0], NULL) != TM_OK) abort(); /* constants of this file */
    def.material[1] = def.material[0];
    return def;
}

static tm_status hold(const app_bench_def *def, app_bench *b, tm_error *error) {
    int32_t layer = (def->cells[0] + 1) * (def->cells[1] + 1), n = b->mesh->vertex_count;
    const int32_t held = (int32_t[]){0, 1, layer, n}[def->held];
    if (!held) return TM_OK;
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)held);
    double *zero = calloc(3 * (size_t)held, sizeof *zero);
    tm_status status;
    if (!dof || !zero) {
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the supports");
    } else {
        for (int32_t i = 0; i < 3 * held; i++) dof[i] = i;
        tm_support_def support = tm_support_def_default();
        support.count = 3 * held, support.dof = dof, support.value_m = zero;
        status = tm_stage_support(b->world, &support, error);
    }
    free(dof);
    free(zero);
    return status;
}

static tm_status open_tissue(const app_bench_def *def, app_bench *b, tm_error *error) {
    double *fibre = NULL;
    if (def->fibre) {
        fibre = malloc(sizeof *fibre * 3 * (size_t)b->mesh->tet_count);
        if (!fibre) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the fibres");
        for (int32_t t = 0; t < b->mesh->tet_count; t++) memcpy(fibre + 3 * t, def->fibre, 3 * sizeof *fibre);
    }
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = b->mesh, tissue.material = def->material, tissue.material_count = def->material_count;
    tissue.fibre = fibre, tissue.precision = def->precision, tissue.cuttable = def->cuttable;
    tissue.scaled_step_s = def->scaled_step_s, tissue.scaled_share = def->scaled_share;
    tissue.rotation = def->rotation;
    tissue.strain_smoothing = def->volume, tissue.smoothed_shear_share = def->smoothed_shear_share;
    tm_status status = tm_tissue_create(&tissue, &b->tissue, error);
    free(fibre);
    return status;
}

static bool second(const app_bench_def *def, const app_block *block, int32_t tet) {
    double centre[3] = {0};
    if (!def->second) return tet >= block->tet_count / 2;
    for (int k = 0; k < 12; k++) centre[k % 3] += 0.25 * block->vertex_m[3 * block->tet[4 * tet + k / 3] + k % 3];
    return def->second(centre);
}

tm_status app_bench_open(const app_bench_def *def, app_bench *b, tm_error *error) {
    app_block block;
    memset(b, 0, sizeof *b);
    if (!app_block_build(&block, def->cells, def->size_m))
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the block");
    int32_t *region = calloc((size_t)block.tet_count, sizeof *region);
    for (int32_t t = 0; region && def->material_count > 1 && t < block.tet_count; t++)
        region[t] = second(def, &block, t);
    if (def->deform) def->deform(block.vertex_m, block.vertex_count, def->argument);
    const tm_status status = app_block_mesh(&block, region, &b->mesh, error);
    free(region);
    app_block_free(&block);
    return status ? status : app_bench_start(def, b, error);
}

tm_status app_bench_start(const app_bench_def *def, app_bench *b, tm_error *error) {
    tm_status status = open_tissue(def, b, error);
    if (status == TM_OK) {
        tm_world_def world = tm_world_def_default();
        world.tissue = b->tissue, world.dt_s = def->dt_s, world.step_fraction = def->step_fraction;
        world.damped = def->material[0].damping_1_s > 0;
        status = tm_world_create(&world, &b->world, error);
    }
    if (status == TM_OK) status = hold(def, b, error);
    if (status == TM_OK && def->rotation > 0) status = tm_stage_rotation(b->world, &b->rotation, error);
    if (status == TM_OK && def->viscosity) status = tm_stage_viscosity(b->world, def->viscosity, error);
    if (status != TM_OK) app_bench_close(b);
    return status;
}

void app_bench_close(app_bench *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    memset(b, 0, sizeof *b);
}
