/* Cost of a mesh's numbering: force pass on a block numbered at random, and renumbered internally
 * (TM_NUMBERING_IMPROVED), relative to the original order. */
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "bench.h"
#include "libtensormass/numeric/random.h"

enum { ORDERS = 3 }; /* in order, numbered at random, the random one renumbered internally */

/* Renumbers the mesh: vertex `was[v]` becomes v. */
static tm_mesh *ordered(const tm_mesh *mesh, const int32_t *was, tm_numbering renumber) {
    const int32_t n = mesh->vertex_count;
    int32_t *now = malloc(sizeof *now * (size_t)n), *tet = malloc(sizeof *tet * 4 * (size_t)mesh->tet_count);
    double *vertex = malloc(sizeof *vertex * 3 * (size_t)n);
    for (int32_t v = 0; v < n; v++) now[was[v]] = v;
    for (int32_t i = 0; i < 3 * n; i++) vertex[i] = mesh->rest_m[3 * was[i / 3] + i % 3];
    for (int32_t i = 0; i < 4 * mesh->tet_count; i++) tet[i] = now[mesh->tet[i]];
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = n, def.vertex_m = vertex, def.tet_count = mesh->tet_count, def.tet = tet;
    def.renumber = renumber;
    tm_mesh *made = NULL;
    tm_error error;
    bench_must(tm_mesh_create(&def, &made, &error), &error);
    free(now), free(tet), free(vertex);
    return made;
}

static tm_mesh *shuffled(const tm_mesh *mesh, tm_numbering renumber) {
    const int32_t n = mesh->vertex_count;
    int32_t *was = malloc(sizeof *was * (size_t)n);
    uint64_t state = 88172645463325252u;
    for (int32_t v = 0; v < n; v++) was[v] = v;
    for (int32_t v = n - 1; v > 0; v--) {
        const int32_t w = (int32_t)(num_xorshift64(&state) % (uint64_t)(v + 1)), other = was[w];
        was[w] = was[v], was[v] = other;
    }
    tm_mesh *made = ordered(mesh, was, renumber);
    free(was);
    return made;
}

static cJSON *one_size(int cells, tm_precision precision, const bench_run *run) {
    const int rounds = run->quick ? 11 : 201;
    tm_mesh *mesh[ORDERS];
    tm_tissue *tissue[ORDERS];
    mesh[0] = bench_block(cells);
    mesh[1] = shuffled(mesh[0], TM_NUMBERING_ORIGINAL), mesh[2] = shuffled(mesh[0], TM_NUMBERING_IMPROVED);
    const int passes = 2 + 100000 / mesh[0]->edge_count;
    double *us[ORDERS], *u = calloc(3 * (size_t)mesh[0]->vertex_count, sizeof *u),
                        *force = malloc(sizeof *force * 3 * (size_t)mesh[0]->vertex_count);
    for (int k = 0; k < ORDERS; k++) {
        tissue[k] = bench_tissue(mesh[k], precision, TM_FORCE_BEST, false);
        us[k] = malloc(sizeof(double) * (size_t)rounds);
    }
    for (int r = -2; r < rounds; r++)
        for (int k = 0; k < ORDERS; k++) {
            const double begin = app_seconds();
            for (int i = 0; i < passes; i++) tm_tissue_force(tissue[k], u, force);
            if (r >= 0) us[k][r] = 1e6 * (app_seconds() - begin) / passes;
        }
    cJSON *row = cJSON_CreateObject(), *quantiles[ORDERS];
    for (int k = 0; k < ORDERS; k++) quantiles[k] = bench_quantiles(us[k], rounds);
    cJSON_AddNumberToObject(row, "tets", mesh[0]->tet_count);
    cJSON_AddStringToObject(row, "precision", precision == TM_DOUBLE ? "double" : "single");
    cJSON_AddNumberToObject(row, "shuffled_over_ordered", us[1][0] / us[0][0]);
    cJSON_AddNumberToObject(row, "renumbered_over_ordered", us[2][0] / us[0][0]);
    cJSON_AddItemToObject(row, "us_per_pass", quantiles[0]);
    cJSON_AddItemToObject(row, "us_per_shuffled_pass", quantiles[1]);
    cJSON_AddItemToObject(row, "us_per_renumbered_pass", quantiles[2]);
    printf("order %7d tets  %s: shuffled %.2f of ordered, renumbered inside %.2f\n", mesh[0]->tet_count,
           precision == TM_DOUBLE ? "double" : "single", us[1][0] / us[0][0], us[2][0] / us[0][0]);
    for (int k = 0; k < ORDERS; k++) {
        tm_tissue_destroy(tissue[k]);
        tm_mesh_destroy(mesh[k]);
        free(us[k]);
    }
    free(u), free(force);
    return row;
}

cJSON *bench_numbering(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int s = 0; s < run->size_count; s++)
        for (int p = 0; p < 2; p++) cJSON_AddItemToArray(rows, one_size(run->cells[s], p ? TM_SINGLE : TM_DOUBLE, run));
    return rows;
}
