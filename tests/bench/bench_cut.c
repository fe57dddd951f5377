/* Cost of removing tetrahedra one per call: in a cautery's order from a corner, and scattered, the worst case for
 * caches and repair. Includes surface, repair, tensors and masses. */
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "bench.h"
#include "libtensormass/numeric/order.h"
#include "libtensormass/numeric/random.h"

/* Sort keys with their tetrahedra: distance from a corner, or random. */
static void order_tets(const tm_mesh *mesh, bool scattered, int32_t *order) {
    struct {
        double key;
        int32_t tet;
    } *item = malloc(sizeof *item * (size_t)mesh->tet_count);
    uint64_t noise = 1;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        num_random64(&noise);
        item[t].tet = t;
        item[t].key = scattered ? (double)(noise >> 11) : 0;
        for (int i = 0; i < 3 && !scattered; i++) {
            double middle = 0;
            for (int k = 0; k < 4; k++) middle += mesh->rest_m[3 * mesh->tet[4 * t + k] + i] / 4;
            item[t].key += middle * middle;
        }
    }
    qsort(item, (size_t)mesh->tet_count, sizeof *item, num_ascending);
    for (int32_t t = 0; t < mesh->tet_count; t++) order[t] = item[t].tet;
    free(item);
}

static cJSON *one_cut(const tm_mesh *mesh, bool scattered, const bench_run *run, double bandwidth_B_s) {
    const int rounds = run->quick ? 1 : 5, most = mesh->tet_count / 3 < 4000 ? mesh->tet_count / 3 : 4000;
    int32_t *order = malloc(sizeof(int32_t) * (size_t)mesh->tet_count), count = 0, removed = 0;
    double *us = malloc(sizeof(double) * (size_t)(rounds * most)), sum = 0;
    order_tets(mesh, scattered, order);
    for (int r = 0; r < rounds; r++) {
        tm_tissue *tissue = bench_tissue(mesh, TM_DOUBLE, TM_FORCE_BEST, true);
        for (int32_t i = 0, calls = 0; i < mesh->tet_count && calls < most; i++) {
            if (!tm_tissue_alive(tissue)[order[i]]) continue;
            const double begin = app_seconds();
            const int32_t gone = tm_cut_remove(tissue, order + i, 1, NULL, 0);
            const double took = 1e6 * (app_seconds() - begin);
            us[count++] = took / gone;
            sum += took;
            removed += gone;
            calls++;
        }
        tm_tissue_destroy(tissue);
    }
    cJSON *row = cJSON_CreateObject();
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddStringToObject(row, "order", scattered ? "scattered" : "cautery");
    cJSON_AddNumberToObject(row, "calls", count);
    cJSON_AddNumberToObject(row, "removed", removed);
    cJSON_AddNumberToObject(row, "us_per_tet", sum / removed);
    const double median = app_median(us, count);
    cJSON_AddItemToObject(row, "us_per_tet_of_a_call", bench_quantiles(us, count));
    cJSON_AddNumberToObject(row, "bandwidth_GB_s", 1e-9 * bandwidth_B_s);
    cJSON_AddNumberToObject(row, "equivalent_bytes_per_tet", 1e-6 * sum / removed * bandwidth_B_s);
    printf("cut   %7d tets  %-9s  %5.2f us per tetrahedron removed, median call %5.2f us (%d calls, %d removed)\n",
           mesh->tet_count, scattered ? "scattered" : "cautery", sum / removed, median, count, removed);
    free(order), free(us);
    return row;
}

cJSON *bench_cut(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int s = 0; s < run->size_count; s++) {
        tm_mesh *mesh = bench_block(run->cells[s]);
        const double bandwidth = app_bandwidth_B_s((size_t)(run->quick ? 8 : 64) << 20, run->quick ? 3 : 9);
        cJSON_AddItemToArray(rows, one_cut(mesh, false, run, bandwidth));
        cJSON_AddItemToArray(rows, one_cut(mesh, true, run, bandwidth));
        tm_mesh_destroy(mesh);
    }
    return rows;
}
