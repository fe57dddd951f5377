/* The benchmark: measures, prints a short table, writes JSON. Asserts nothing about speed. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "app.h"
#include "bandwidth.h"
#include "bench.h"
#include "block.h"
#include "json_file.h"
#include "libtensormass/numeric/order.h"

void bench_must(tm_status status, const tm_error *error) {
    if (status == TM_OK) return;
    fprintf(stderr, "bench: %s\n", error->message);
    exit(APP_FAILED);
}

cJSON *bench_quantiles(double *value, int count) {
    double sum = 0;
    num_sort(value, count);
    for (int i = 0; i < count; i++) sum += value[i];
    cJSON *q = cJSON_CreateObject();
    cJSON_AddNumberToObject(q, "min", value[0]);
    cJSON_AddNumberToObject(q, "p50", value[count / 2]);
    cJSON_AddNumberToObject(q, "p99", value[(int)(0.99 * (count - 1))]);
    cJSON_AddNumberToObject(q, "max", value[count - 1]);
    cJSON_AddNumberToObject(q, "mean", sum / count);
    cJSON_AddNumberToObject(q, "count", count);
    return q;
}

tm_mesh *bench_block_of(int cells, double side_m) {
    app_block block;
    tm_mesh *mesh = NULL;
    tm_error error = {.message = "no memory for the block; run with --quick"};
    if (!app_block_build(&block, (int32_t[3]){cells, cells, cells}, (double[3]){side_m, side_m, side_m}))
        bench_must(TM_ERR_MEMORY, &error);
    bench_must(app_block_mesh(&block, NULL, &mesh, &error), &error);
    app_block_free(&block);
    return mesh;
}

tm_mesh *bench_block(int cells) { return bench_block_of(cells, 0.1); }

/* The lowest vertices. */
static void hold(tm_world *world, const tm_mesh *mesh) {
    double lowest = mesh->rest_m[2];
    for (int32_t v = 0; v < mesh->vertex_count; v++) lowest = fmin(lowest, mesh->rest_m[3 * v + 2]);
    int32_t *dof = malloc(sizeof(int32_t) * 3 * (size_t)mesh->vertex_count);
    double *zero = calloc(3 * (size_t)mesh->vertex_count, sizeof(double));
    tm_support_def support = tm_support_def_default();
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++)
        if (mesh->rest_m[i / 3 * 3 + 2] < lowest + 1e-9) dof[support.count++] = i;
    support.dof = dof, support.value_m = zero;
    tm_error error;
    bench_must(tm_stage_support(world, &support, &error), &error);
    free(dof), free(zero);
}

tm_tissue *bench_tissue(const tm_mesh *mesh, tm_precision precision, tm_force_form form, bool cuttable) {
    tm_material material;
    tm_error error;
    bench_must(tm_material_young(5e3, 0.45, &material, &error), &error);
    material.damping_1_s = 50;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material, def.precision = precision, def.form = form,
    def.cuttable = cuttable;
    tm_tissue *tissue = NULL;
    bench_must(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

tm_world *bench_world(tm_tissue *tissue, int threads) {
    tm_world_def def = tm_world_def_default();
    def.tissue = tissue, def.threads = threads;
    tm_world *world = NULL;
    tm_error error;
    bench_must(tm_world_create(&def, &world, &error), &error);
    bench_must(tm_stage_gravity(world, (const double[3]){0, 0, -9.81}, &error), &error);
    hold(world, tm_tissue_mesh(tissue));
    return world;
}

static cJSON *machine(void) {
    char line[256], name[200] = "unknown";
    FILE *file = fopen("/proc/cpuinfo", "r");
    while (file && fgets(line, sizeof line, file))
        if (sscanf(line, "model name : %199[^\n]", name) == 1) break;
    if (file) fclose(file);
    cJSON *m = cJSON_CreateObject();
    cJSON_AddStringToObject(m, "cpu", name);
    cJSON_AddNumberToObject(m, "cores", (double)sysconf(_SC_NPROCESSORS_ONLN));
    return m;
}

static void add_text(cJSON *root, const char *key, const char *value) {
    cJSON_AddStringToObject(root, key, value && *value ? value : "unknown");
}

static const struct {
    const char *name;
    cJSON *(*measure)(const bench_run *run);
} row[] = {{"force", bench_force},      {"numbering", bench_numbering}, {"step", bench_step},   {"law", bench_law},
           {"effects", bench_effects},  {"hybrid", bench_hybrid},       {"touch", bench_touch}, {"cut", bench_cut},
           {"capacity", bench_capacity}};
enum { ROWS = sizeof row / sizeof *row };

static int measure(const char *path, bool quick, const char *only) {
    static const int all[] = {6, 12, 20, 26}, few[] = {4, 6};
    const bench_run run = {quick, quick ? 2 : 4, quick ? few : all};
    cJSON *root = cJSON_CreateObject();
    char when[40];
    const time_t now = time(NULL);
    strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%SZ", gmtime(&now));
    add_text(root, "commit", getenv("TM_COMMIT"));
    add_text(root, "compiler", __VERSION__);
    add_text(root, "flags", getenv("TM_FLAGS"));
    add_text(root, "when", when);
    cJSON_AddItemToObject(root, "machine", machine());
    cJSON_AddBoolToObject(root, "quick", quick);
    cJSON_AddNumberToObject(root, "bandwidth_GB_s",
                            1e-9 * app_bandwidth_B_s((size_t)(quick ? 8 : 200) << 20, quick ? 3 : 9));
    for (int i = 0; i < ROWS; i++)
        if (!only || strcmp(only, row[i].name) == 0) cJSON_AddItemToObject(root, row[i].name, row[i].measure(&run));
    tm_error error;
    const tm_status status = path ? app_json_write(path, root, &error) : TM_OK;
    cJSON_Delete(root);
    return status ? app_report(NULL, 0, &error) : APP_DONE;
}

static void usage(FILE *to) {
    fprintf(
        to,
        "usage: bench [--quick] [--row NAME] [--json FILE]\nCost of a force pass, a step and a removed tetrahedron, beside "
        "the memory bandwidth of this machine.\n");
}

int main(int argc, char **argv) {
    static const struct option options[] = {{"json", required_argument, NULL, 'j'}, {"quick", no_argument, NULL, 'q'},
                                            {"row", required_argument, NULL, 'r'},  {"help", no_argument, NULL, 'h'},
                                            {"version", no_argument, NULL, 'v'},    {0}};
    const char *path = NULL, *only = NULL;
    bool quick = false;
    for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) switch (option) {
        case 'j': path = optarg; break;
        case 'q': quick = true; break;
        case 'r': only = optarg; break;
        case 'h': usage(stdout); return APP_DONE;
        case 'v': printf("bench %s\n", tm_version()); return APP_DONE;
        default: usage(stderr); return APP_BAD_INPUT;
        }
    bool known = !only;
    for (int i = 0; i < ROWS; i++) known = known || strcmp(only, row[i].name) == 0;
    if (!known) return app_bad_input(NULL, 0, "bench: no row '%s'; docs/benchmark.md lists them", only);
    return measure(path, quick, only);
}
