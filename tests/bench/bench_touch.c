/* Cost of contact of tissue with tissue: a block that rests on another of the same size, compared with the same step
 * without the stage. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "bench.h"
#include "block.h"

#define SIDE_M 0.03
#define REST_S 0.5

/* Makes two blocks of cells^3 cubes, the upper one a thickness above the lower and moved by half a cell. */
static tm_mesh *two_blocks(int cells, int32_t **tet_body) {
    app_block block;
    tm_error error = {.message = "no memory for the blocks; run with --quick"};
    tm_mesh *mesh = NULL;
    if (!app_block_build(&block, (int32_t[3]){cells, cells, cells}, (double[3]){SIDE_M, SIDE_M, SIDE_M}))
        bench_must(TM_ERR_MEMORY, &error);
    const int32_t n = block.vertex_count, tets = block.tet_count;
    const double move_m[3] = {0.5 * SIDE_M / cells, 0.5 * SIDE_M / cells,
                              SIDE_M + tm_touching_def_default().thickness_m};
    double *vertex = malloc(sizeof *vertex * 6 * (size_t)n);
    int32_t *tet = malloc(sizeof *tet * 8 * (size_t)tets);
    *tet_body = calloc(2 * (size_t)tets, sizeof **tet_body);
    if (!vertex || !tet || !*tet_body) bench_must(TM_ERR_MEMORY, &error);
    for (int32_t i = 0; i < 3 * n; i++)
        vertex[i] = block.vertex_m[i], vertex[3 * n + i] = block.vertex_m[i] + move_m[i % 3];
    for (int32_t i = 0; i < 4 * tets; i++) tet[i] = block.tet[i], tet[4 * tets + i] = block.tet[i] + n;
    for (int32_t i = 0; i < tets; i++) (*tet_body)[tets + i] = 1;
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = 2 * n, def.vertex_m = vertex, def.tet_count = 2 * tets, def.tet = tet;
    bench_must(tm_mesh_create(&def, &mesh, &error), &error);
    free(vertex), free(tet);
    app_block_free(&block);
    return mesh;
}

static cJSON *one_size(int cells, const bench_run *run) {
    const int rounds = run->quick ? 5 : 61;
    int32_t *tet_body;
    tm_error error;
    tm_mesh *mesh = two_blocks(cells, &tet_body);
    tm_tissue *tissue = bench_tissue(mesh, TM_DOUBLE, TM_FORCE_BEST, false);
    tm_world *world[2] = {bench_world(tissue, 1), bench_world(tissue, 1)}; /* without, with */
    tm_touching_def def = tm_touching_def_default();
    tm_touching *touching = NULL;
    def.body_count = 2, def.tet_body = tet_body;
    bench_must(tm_stage_touch(world[1], &def, &touching, &error), &error);
    const int steps = 8 + 40000 / mesh->edge_count;
    for (int k = 0; k < 2; k++) /* until the upper block rests; without contact it falls */
        bench_must(tm_world_step(world[k], (int)(REST_S / tm_world_step_s(world[k]))), &error);
    double *us[2] = {malloc(sizeof(double) * (size_t)rounds), malloc(sizeof(double) * (size_t)rounds)};
    for (int r = 0; r < rounds; r++)
        for (int k = 0; k < 2; k++) {
            const double begin = app_seconds();
            bench_must(tm_world_step(world[k], steps), &error);
            us[k][r] = 1e6 * (app_seconds() - begin) / steps;
        }
    const tm_touching_report report = tm_touching_get_report(touching);
    cJSON *row = cJSON_CreateObject(), *without = bench_quantiles(us[0], rounds),
          *with = bench_quantiles(us[1], rounds);
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddNumberToObject(row, "rows", report.rows);
    cJSON_AddNumberToObject(row, "over_without", us[1][0] / us[0][0]); /* sorted: the least of each */
    cJSON_AddItemToObject(row, "us_per_step", with);
    cJSON_AddItemToObject(row, "us_per_step_without", without);
    printf("touch   %6d tets  %5d rows  %8.1f us, least %5.2f of a step without\n", mesh->tet_count, report.rows,
           us[1][rounds / 2], us[1][0] / us[0][0]);
    for (int k = 0; k < 2; k++) tm_world_destroy(world[k]), free(us[k]);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    free(tet_body);
    return row;
}

cJSON *bench_touch(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int s = 0; s < run->size_count && run->cells[s] <= 20; s++)
        cJSON_AddItemToArray(rows, one_size(run->cells[s], run));
    return rows;
}
