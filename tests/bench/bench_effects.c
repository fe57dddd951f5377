/* Cost of a step with effects, all tetrahedra rotated, on one thread and on two, compared with the linear step of the
 * same mesh. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "bench.h"

enum { ROTATION = 1, VOLUME = 2, VISCOSITY = 4, NEO_HOOKE = 8, FUNG = 16 };
enum { LINEAR, ONE, TWO, KINDS };
static const struct {
    const char *name;
    int with;
} combination[] = {{"rotation", ROTATION},
                   {"volume", VOLUME},
                   {"viscosity", VISCOSITY},
                   {"rotation volume", ROTATION | VOLUME},
                   {"rotation viscosity", ROTATION | VISCOSITY},
                   {"volume viscosity", VOLUME | VISCOSITY},
                   {"rotation volume viscosity", ROTATION | VOLUME | VISCOSITY},
                   {"law neo-hooke", NEO_HOOKE},
                   {"law fung", FUNG}};
enum { COMBINATIONS = sizeof combination / sizeof *combination };

static tm_tissue *tissue_with(const tm_mesh *mesh, int with) {
    tm_material material;
    tm_error error;
    bench_must(tm_material_young(5e3, 0.45, &material, &error), &error);
    material.damping_1_s = 50;
    if (with & (NEO_HOOKE | FUNG))
        bench_must(tm_material_set_law(&material, with & FUNG ? TM_LAW_FUNG : TM_LAW_NEO_HOOKE,
                                       (double[TM_LAW_CONSTANTS]){with & FUNG ? 1e4 : 0}, 0, &error),
                   &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material;
    def.rotation = with & ROTATION ? TM_ROTATION_THRESHOLD : 0;
    def.strain_smoothing = with & VOLUME, def.smoothed_shear_share = 0;
    tm_tissue *tissue = NULL;
    bench_must(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

/* Not supported, rotated by 40 degrees. */
static tm_world *world_with(tm_tissue *tissue, int with, int threads) {
    tm_world_def def = tm_world_def_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    tm_world *world = NULL;
    tm_error error;
    def.tissue = tissue, def.threads = threads;
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.3, 0.1}, viscosity.term[1] = (tm_viscosity_term){0.3, 0.2, 0};
    bench_must(tm_world_create(&def, &world, &error), &error);
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    tm_state *s = tm_world_state(world);
    const double c = cos(0.7), w = sin(0.7);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const double *x = mesh->rest_m + 3 * (int64_t)v, to[3] = {c * x[0] - w * x[1], w * x[0] + c * x[1], x[2]};
        for (int i = 0; i < 3; i++) s->u_m[3 * v + i] = s->u_prev_m[3 * v + i] = to[i] - x[i];
    }
    if (with & ROTATION) bench_must(tm_stage_rotation(world, NULL, &error), &error);
    if (with & VISCOSITY) bench_must(tm_stage_viscosity(world, &viscosity, &error), &error);
    return world;
}

static cJSON *one_combination(const tm_mesh *mesh, tm_world *linear, int which, const bench_run *run) {
    const int rounds = run->quick ? 5 : 61, steps = 8 + 40000 / mesh->edge_count, with = combination[which].with;
    tm_tissue *tissue = tissue_with(mesh, with);
    tm_world *world[KINDS] = {linear, world_with(tissue, with, 1), world_with(tissue, with, 2)};
    double *us[KINDS];
    for (int k = 0; k < KINDS; k++) us[k] = malloc(sizeof(double) * (size_t)rounds);
    for (int r = -2; r < rounds; r++) /* two rounds warm up */
        for (int k = 0; k < KINDS; k++) {
            const double begin = app_seconds();
            tm_world_step(world[k], steps);
            if (r >= 0) us[k][r] = 1e6 * (app_seconds() - begin) / steps;
        }
    cJSON *row = cJSON_CreateObject(), *single = bench_quantiles(us[ONE], rounds),
          *divided = bench_quantiles(us[TWO], rounds);
    bench_quantiles(us[LINEAR], rounds);
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddStringToObject(row, "effects", combination[which].name);
    cJSON_AddNumberToObject(row, "over_linear", us[ONE][0] / us[LINEAR][0]);
    cJSON_AddNumberToObject(row, "threads", tm_world_partitions(world[TWO]));
    cJSON_AddNumberToObject(row, "speedup", us[ONE][0] / us[TWO][0]);
    cJSON_AddItemToObject(row, "us_per_step", single);
    cJSON_AddItemToObject(row, "us_per_divided_step", divided);
    printf("effects %6d tets  %-26s %8.1f us, least %5.2f of a linear step, %.2f times faster on %d threads\n",
           mesh->tet_count, combination[which].name, us[ONE][rounds / 2], us[ONE][0] / us[LINEAR][0],
           us[ONE][0] / us[TWO][0], tm_world_partitions(world[TWO]));
    for (int k = 0; k < KINDS; k++) free(us[k]);
    tm_world_destroy(world[ONE]);
    tm_world_destroy(world[TWO]);
    tm_tissue_destroy(tissue);
    return row;
}

cJSON *bench_effects(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int s = 1; s < run->size_count; s++) {
        tm_mesh *mesh = bench_block(run->cells[s]);
        tm_tissue *tissue = tissue_with(mesh, 0);
        tm_world *linear = world_with(tissue, 0, 1);
        for (int k = 0; k < COMBINATIONS; k++) cJSON_AddItemToArray(rows, one_combination(mesh, linear, k, run));
        tm_world_destroy(linear);
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh);
    }
    return rows;
}
