/* Cost of the force pass in both precisions and forms, compared with a plain loop (naive.c). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "bench.h"
#include "naive.h"

enum { BEST, PLAIN, NAIVE, WIDE, FORMS, KINDS = 2 * FORMS }; /* double, then single */
static const char *const form_name[FORMS] = {"best", "plain", "naive", "naive wide"};

static bool has_wide(void) {
#ifdef __x86_64__
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return false;
#endif
}

typedef struct yardstick {
    double *block;
    naive_edge *edge;
    naive_edge_single *edge_single;
} yardstick;

typedef struct subject {
    const tm_mesh *mesh;
    tm_tissue *tissue[KINDS]; /* naive: null */
    yardstick naive;
    double *u, *f, *seconds[KINDS];
} subject;

static bool is_single(int kind) { return kind >= FORMS; }

/* Minimum bytes that one pass moves: tensors, neighbours, u read, force zeroed and written. */
static double pass_bytes(const tm_mesh *mesh, int kind) {
    const double real = is_single(kind) ? 4 : 8, neighbours = kind % FORMS >= NAIVE ? 8 : 4;
    return mesh->edge_count * (9 * real + neighbours) + mesh->vertex_count * (9 * 8 + 8 + 3 * 8 * 3.0);
}

static void take_yardstick(subject *s) {
    const tm_tissue *tissue = s->tissue[BEST];
    const tm_pair_view pairs = tm_tissue_pairs(tissue);
    yardstick *y = &s->naive;
    y->block = malloc(sizeof(double) * 9 * (size_t)s->mesh->vertex_count);
    y->edge = malloc(sizeof *y->edge * (size_t)pairs.count);
    y->edge_single = malloc(sizeof *y->edge_single * (size_t)pairs.count);
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) tm_tissue_vertex_tensor(tissue, v, y->block + 9 * v);
    for (int32_t e = 0; e < pairs.count; e++) {
        tm_tissue_pair_tensor(tissue, e, y->edge[e].K);
        for (int i = 0; i < 9; i++) y->edge_single[e].K[i] = (float)y->edge[e].K[i];
        y->edge[e].a = y->edge_single[e].a = pairs.ends[2 * e];
        y->edge[e].b = y->edge_single[e].b = pairs.ends[2 * e + 1];
    }
}

static void pass(const subject *s, int kind) {
    const int vertices = s->mesh->vertex_count, edges = s->mesh->edge_count;
    const bool wide = kind % FORMS == WIDE;
    if (s->tissue[kind])
        tm_tissue_force(s->tissue[kind], s->u, s->f);
    else if (is_single(kind))
        (wide ? naive_wide_single : naive_plain_single)(vertices, s->naive.block, edges, s->naive.edge_single, s->u,
                                                        s->f);
    else
        (wide ? naive_wide_double : naive_plain_double)(vertices, s->naive.block, edges, s->naive.edge, s->u, s->f);
}

/* Returns the largest difference from the library's force, relative to the largest force: both do the same work. */
static double difference(const subject *s, int kind) {
    double worst = 0, most = 0;
    double *truth = malloc(sizeof(double) * 3 * (size_t)s->mesh->vertex_count);
    tm_tissue_force(s->tissue[BEST], s->u, truth);
    pass(s, kind);
    for (int i = 0; i < 3 * s->mesh->vertex_count; i++) {
        worst = fmax(worst, fabs(s->f[i] - truth[i]));
        most = fmax(most, fabs(truth[i]));
    }
    free(truth);
    return worst / most;
}

static double least(const double *seconds, int rounds) {
    double value = seconds[0];
    for (int i = 1; i < rounds; i++) value = fmin(value, seconds[i]);
    return value;
}

static cJSON *one_force(const subject *s, int kind, int rounds, double bandwidth_B_s) {
    const tm_mesh *mesh = s->mesh;
    const char *precision = is_single(kind) ? "single" : "double";
    cJSON *row = cJSON_CreateObject();
    cJSON_AddNumberToObject(row, "tets", mesh->tet_count);
    cJSON_AddNumberToObject(row, "vertices", mesh->vertex_count);
    cJSON_AddNumberToObject(row, "edges", mesh->edge_count);
    cJSON_AddStringToObject(row, "precision", precision);
    cJSON_AddStringToObject(row, "form", form_name[kind % FORMS]);
    cJSON_AddNumberToObject(row, "difference", difference(s, kind));
    const double quickest = least(s->seconds[kind], rounds),
                 own = least(s->seconds[is_single(kind) ? FORMS + NAIVE : NAIVE], rounds),
                 plain_double = least(s->seconds[NAIVE], rounds);
    cJSON_AddNumberToObject(row, "over_naive", quickest / own);
    cJSON_AddNumberToObject(row, "over_naive_double", quickest / plain_double);
    const double wide_double = has_wide() ? least(s->seconds[WIDE], rounds) : NAN;
    if (has_wide()) cJSON_AddNumberToObject(row, "over_naive_wide_double", quickest / wide_double);
    double *us = malloc(sizeof(double) * (size_t)rounds);
    for (int i = 0; i < rounds; i++) us[i] = 1e6 * s->seconds[kind][i];
    const double median = 1e-6 * app_median(us, rounds), bytes = pass_bytes(mesh, kind);
    cJSON_AddItemToObject(row, "us_per_pass", bench_quantiles(us, rounds));
    free(us);
    cJSON_AddNumberToObject(row, "ns_per_edge", 1e9 * median / mesh->edge_count);
    cJSON_AddNumberToObject(row, "bytes_per_pass", bytes);
    cJSON_AddNumberToObject(row, "GB_s", 1e-9 * bytes / median);
    cJSON_AddNumberToObject(row, "bandwidth_GB_s", 1e-9 * bandwidth_B_s);
    cJSON_AddNumberToObject(row, "share_of_bandwidth", bytes / median / bandwidth_B_s);
    printf("force %7d tets  %s %-10s  %8.1f us  %5.2f ns/edge  %.2f of the naive loop, %.2f and (AVX2) %.2f of it in "
           "double  %5.1f of %5.1f GB/s\n",
           mesh->tet_count, precision, form_name[kind % FORMS], 1e6 * median, 1e9 * median / mesh->edge_count,
           quickest / own, quickest / plain_double, quickest / wide_double, 1e-9 * bytes / median,
           1e-9 * bandwidth_B_s);
    return row;
}

static void make_subject(subject *s, tm_mesh *mesh, int rounds) {
    const size_t n = 3 * (size_t)mesh->vertex_count;
    *s = (subject){.mesh = mesh, .u = malloc(sizeof(double) * n), .f = malloc(sizeof(double) * n)};
    for (size_t i = 0; i < n; i++) s->u[i] = 1e-3 * sin(1.7 * (double)i);
    for (int k = 0; k < KINDS; k++) {
        s->seconds[k] = malloc(sizeof(double) * (size_t)rounds);
        if (k % FORMS >= NAIVE) continue;
        s->tissue[k] = bench_tissue(mesh, is_single(k) ? TM_SINGLE : TM_DOUBLE,
                                    k % FORMS == PLAIN ? TM_FORCE_PLAIN : TM_FORCE_BEST, false);
    }
    take_yardstick(s);
}

static void free_subject(subject *s) {
    for (int k = 0; k < KINDS; k++) {
        tm_tissue_destroy(s->tissue[k]);
        free(s->seconds[k]);
    }
    free(s->u), free(s->f);
    free(s->naive.block), free(s->naive.edge), free(s->naive.edge_single);
}

cJSON *bench_force(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int i = 0; i < run->size_count; i++) {
        tm_mesh *mesh = bench_block(run->cells[i]);
        const int rounds = run->quick ? 11 : 201, passes = 1 + (run->quick ? 20000 : 200000) / mesh->edge_count;
        subject s;
        make_subject(&s, mesh, rounds);
        for (int r = -2; r < rounds; r++) /* two rounds warm up */
            for (int k = 0; k < KINDS; k++) {
                if (k % FORMS == WIDE && !has_wide()) continue;
                pass(&s, k); /* the other kinds' arrays filled the caches; a simulation has only one kind */
                const double begin = app_seconds();
                for (int p = 0; p < passes; p++) pass(&s, k);
                if (r >= 0) s.seconds[k][r] = (app_seconds() - begin) / passes;
            }
        const double bandwidth = app_bandwidth_B_s((size_t)pass_bytes(mesh, BEST), run->quick ? 3 : 15);
        for (int k = 0; k < KINDS; k++)
            if (k % FORMS != WIDE || has_wide()) cJSON_AddItemToArray(rows, one_force(&s, k, rounds, bandwidth));
        free_subject(&s);
        tm_mesh_destroy(mesh);
    }
    return rows;
}
