/* The force pass in both precisions and forms. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "bench.h"

enum { KINDS = 4 }; /* precision x form */

/* What one pass must move at the least: tensors, neighbours, u read, force zeroed and written. */
static double pass_bytes(const tm_mesh *mesh, tm_precision precision) {
    const double real = precision == TM_SINGLE ? 4 : 8;
    return mesh->edge_count * (9 * real + 4.0) + mesh->vertex_count * (9 * 8 + 8 + 3 * 8 * 3.0);
}

static cJSON *one_force(const tm_mesh *mesh, int kind, double *seconds, int rounds, double bandwidth_B_s) {
    const tm_precision precision = kind / 2 ? TM_SINGLE : TM_DOUBLE;
    cJSON *row = cJSON_CreateObject();
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddNumberToObject(row, "vertices", mesh->vertex_count);
    cJSON_AddNumberToObject(row, "edges", mesh->edge_count);
    cJSON_AddStringToObject(row, "precision", precision == TM_SINGLE ? "single" : "double");
    cJSON_AddStringToObject(row, "form", kind % 2 ? "plain" : "best");
    const double median = app_median(seconds, rounds), bytes = pass_bytes(mesh, precision);
    for (int i = 0; i < rounds; i++) seconds[i] *= 1e6;
    cJSON_AddItemToObject(row, "us_per_pass", bench_quantiles(seconds, rounds));
    cJSON_AddNumberToObject(row, "ns_per_edge", 1e9 * median / mesh->edge_count);
    cJSON_AddNumberToObject(row, "bytes_per_pass", bytes);
    cJSON_AddNumberToObject(row, "GB_s", 1e-9 * bytes / median);
    cJSON_AddNumberToObject(row, "bandwidth_GB_s", 1e-9 * bandwidth_B_s);
    cJSON_AddNumberToObject(row, "share_of_bandwidth", bytes / median / bandwidth_B_s);
    printf("force %7d tets  %s %s  %8.1f us  %5.2f ns/edge  %5.1f of %5.1f GB/s\n", mesh->tet_count,
           precision == TM_SINGLE ? "single" : "double", kind % 2 ? "plain" : "best ", 1e6 * median,
           1e9 * median / mesh->edge_count, 1e-9 * bytes / median, 1e-9 * bandwidth_B_s);
    return row;
}

cJSON *bench_force(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int s = 0; s < run->size_count; s++) {
        tm_mesh *mesh = bench_block(run->cells[s]);
        tm_tissue *tissue[KINDS];
        const int n = 3 * mesh->vertex_count, rounds = run->quick ? 11 : 201,
                  passes = 1 + (run->quick ? 20000 : 200000) / mesh->edge_count;
        double *u = malloc(sizeof(double) * (size_t)n), *f = malloc(sizeof(double) * (size_t)n), *seconds[KINDS];
        for (int i = 0; i < n; i++) u[i] = 1e-3 * sin(1.7 * i);
        for (int k = 0; k < KINDS; k++) {
            tissue[k] =
                bench_tissue(mesh, k / 2 ? TM_SINGLE : TM_DOUBLE, k % 2 ? TM_FORCE_PLAIN : TM_FORCE_BEST, false);
            seconds[k] = malloc(sizeof(double) * (size_t)rounds);
        }
        for (int r = -2; r < rounds; r++) /* two rounds warm up */
            for (int k = 0; k < KINDS; k++) {
                tm_tissue_force(tissue[k], u, f); /* the other kinds' arrays filled the caches; a simulation has one */
                const double begin = app_seconds();
                for (int p = 0; p < passes; p++) tm_tissue_force(tissue[k], u, f);
                if (r >= 0) seconds[k][r] = (app_seconds() - begin) / passes;
            }
        const double bandwidth = app_bandwidth_B_s((size_t)pass_bytes(mesh, TM_DOUBLE), run->quick ? 3 : 15);
        for (int k = 0; k < KINDS; k++) {
            cJSON_AddItemToArray(rows, one_force(mesh, k, seconds[k], rounds, bandwidth));
            tm_tissue_destroy(tissue[k]);
            free(seconds[k]);
        }
        free(u), free(f);
        tm_mesh_destroy(mesh);
    }
    return rows;
}
