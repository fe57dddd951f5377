/* Cost of a complete step on one and several threads, compared with the force pass alone. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "bandwidth.h"
#include "bench.h"

static const double FRAME_S = 1.0 / 25;
enum { FORCE, ONE, MANY, KINDS }; /* a force pass, a step on one thread, a step on all cores */

static void add_settling(cJSON *row, tm_world *world) {
    tm_settle_def settle = tm_settle_def_default();
    tm_settle_result rest;
    tm_error error;
    const double begin = app_seconds();
    bench_must(tm_world_settle(world, &settle, &rest, &error), &error);
    cJSON_AddNumberToObject(row, "settle_s", app_seconds() - begin);
    cJSON_AddNumberToObject(row, "settle_steps", (double)rest.steps);
    cJSON_AddNumberToObject(row, "settle_residual", rest.residual);
}

static cJSON *one_step(const tm_mesh *mesh, tm_tissue *tissue, tm_world *one, tm_world *many, const bench_run *run) {
    /* Work that a call does once (saving the state for a rollback, waking threads) is shared by a frame's steps. */
    const int rounds = run->quick ? 11 : 101, steps = (int)ceil(FRAME_S / tm_world_step_s(one));
    double *us[KINDS], *force = malloc(sizeof(double) * 3 * (size_t)mesh->vertex_count);
    for (int k = 0; k < KINDS; k++) us[k] = malloc(sizeof(double) * (size_t)rounds);
    for (int r = -2; r < rounds; r++) /* two rounds warm up */
        for (int k = 0; k < KINDS; k++) {
            const double begin = app_seconds();
            if (k == FORCE)
                for (int i = 0; i < steps; i++) tm_tissue_force(tissue, tm_world_state(one)->u_m, force);
            else
                tm_world_step(k == ONE ? one : many, steps);
            if (r >= 0) us[k][r] = 1e6 * (app_seconds() - begin) / steps;
        }
    cJSON *row = cJSON_CreateObject(), *pass = bench_quantiles(us[FORCE], rounds),
          *single = bench_quantiles(us[ONE], rounds), *divided = bench_quantiles(us[MANY], rounds);
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddNumberToObject(row, "vertices", mesh->vertex_count);
    cJSON_AddNumberToObject(row, "steps_a_call", steps);
    cJSON_AddNumberToObject(row, "dt_us", 1e6 * tm_world_step_s(one));
    cJSON_AddNumberToObject(row, "sim_seconds_per_wall_second", 1e6 * tm_world_step_s(one) / us[ONE][rounds / 2]);
    cJSON_AddNumberToObject(row, "step_over_force", us[ONE][0] / us[FORCE][0]);
    cJSON_AddNumberToObject(row, "threads", tm_world_partitions(many));
    cJSON_AddNumberToObject(row, "speedup", us[ONE][0] / us[MANY][0]);
    cJSON_AddItemToObject(row, "us_per_force_pass", pass);
    cJSON_AddItemToObject(row, "us_per_step", single);
    cJSON_AddItemToObject(row, "us_per_divided_step", divided);
    printf("step  %7d tets  %8.1f us, of %.0f us simulated; least %.2f of a force pass, %.2f times faster on %d "
           "threads\n",
           mesh->tet_count, us[ONE][rounds / 2], 1e6 * tm_world_step_s(one), us[ONE][0] / us[FORCE][0],
           us[ONE][0] / us[MANY][0], tm_world_partitions(many));
    for (int k = 0; k < KINDS; k++) free(us[k]);
    free(force);
    return row;
}

cJSON *bench_step(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    for (int s = 0; s < run->size_count; s++) {
        tm_mesh *mesh = bench_block(run->cells[s]);
        tm_tissue *tissue = bench_tissue(mesh, TM_DOUBLE, TM_FORCE_BEST, false);
        tm_world *one = bench_world(tissue, 1),
                 *many = bench_world(tissue, cores < TM_MAX_THREADS ? (int)cores : TM_MAX_THREADS);
        cJSON *row = one_step(mesh, tissue, one, many, run);
        add_settling(row, one);
        cJSON_AddItemToArray(rows, row);
        tm_world_destroy(one);
        tm_world_destroy(many);
        tm_tissue_destroy(tissue);
        tm_mesh_destroy(mesh);
    }
    return rows;
}
