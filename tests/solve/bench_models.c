/* Costs of the precomputed model: precomputation against mesh size for both solvers, and updates with some thirty
 * contact rows. `make bench-models`; figures in build/bench/models.json. Asserts nothing. */
#include "organ.h"

#include <cjson/cJSON.h>
#include <sys/resource.h>

#include "bandwidth.h"

static const double ENOUGH_S = 20; /* of conjugate gradients: the others are proportional */

static double processor_s(void) { return app_clock_s(CLOCK_PROCESS_CPUTIME_ID); }

typedef struct watch {
    double begin_s, fraction;
    bool stop;
} watch;

static bool watch_columns(void *user, const char *what, double fraction, double left) {
    watch *w = user;
    (void)left;
    if (strcmp(what, "responses")) return true;
    if (fraction == 0) w->begin_s = processor_s();
    w->fraction = fraction;
    return !(w->stop && fraction > 0 && processor_s() - w->begin_s > ENOUGH_S);
}

static void ahead(const char *size, const organ *o, const tm_tissue *tissue, tm_solver solver, cJSON *list) {
    tm_precomputed_def def = tm_precomputed_def_default();
    watch w = {.stop = solver == TM_SOLVER_CG};
    def.problem = kit_problem(tissue, o->fixed);
    def.problem.solver = solver;
    def.problem.cg_tolerance = 1e-8;
    def.problem.progress = watch_columns;
    def.problem.user = &w;
    tm_precomputed *model = NULL;
    tm_solve_report r;
    tm_error error;
    const double begin = processor_s();
    const tm_status status = tm_precomputed_create(&def, &model, &r, &error);
    const double end = processor_s();
    if (status != TM_OK && !(w.stop && w.fraction > 0)) fix_ok(status, &error);
    const double columns_s = (end - w.begin_s) / w.fraction, all_s = w.begin_s - begin + columns_s;
    printf("| %s | %d | %s | %d | %.2f | %.1f%s | %.0f | %.0f | %.0f |\n", size, o->mesh->vertex_count,
           solver == TM_SOLVER_CG ? "CG" : "CHOLMOD", r.columns, w.begin_s - begin, all_s, w.fraction < 1 ? " *" : "",
           1e-6 * (double)r.factor_bytes, 1e-6 * (double)r.responses_bytes, 1e-6 * (double)r.work_bytes);
    fflush(stdout);
    cJSON *j = cJSON_CreateObject();
    cJSON_AddItemToArray(list, j);
    cJSON_AddStringToObject(j, "solver", solver == TM_SOLVER_CG ? "cg" : "cholesky");
    cJSON_AddNumberToObject(j, "tets", o->mesh->tet_count);
    cJSON_AddNumberToObject(j, "vertices", o->mesh->vertex_count);
    cJSON_AddNumberToObject(j, "free_dofs", r.free_dofs);
    cJSON_AddNumberToObject(j, "columns", r.columns);
    cJSON_AddNumberToObject(j, "prepare_processor_s", w.begin_s - begin);
    cJSON_AddNumberToObject(j, "processor_s", all_s);
    cJSON_AddNumberToObject(j, "measured_fraction", w.fraction);
    cJSON_AddNumberToObject(j, "factor_bytes", (double)r.factor_bytes);
    cJSON_AddNumberToObject(j, "responses_bytes", (double)r.responses_bytes);
    cJSON_AddNumberToObject(j, "work_bytes", (double)r.work_bytes);
    tm_precomputed_destroy(model);
}

/* --- on line --- */

static int rows_with_force(const tm_precomputed *model) {
    const tm_contact_row *row;
    const int32_t count = tm_precomputed_rows(model, &row);
    int n = 0;
    for (int32_t i = 0; i < count; i++) n += row[i].lambda_N > 0;
    return n;
}

/* Two shafts across the right lobe from the sides, at one height. */
static void lay(tm_tool_pose pose[2], double height, double along) {
    for (int t = 0; t < 2; t++) {
        const double y = t ? 0.03 : -0.03;
        pose[t] = (tm_tool_pose){.tip_m = {-0.075 + along, y, height}, .active = true};
    }
}

static void quantiles(cJSON *j, const char *name, double *us, int n) {
    const double p50 = app_median(us, n); /* sorts */
    cJSON *q = cJSON_AddObjectToObject(j, name);
    cJSON_AddNumberToObject(q, "p50", p50);
    cJSON_AddNumberToObject(q, "p99", us[n * 99 / 100]);
    cJSON_AddNumberToObject(q, "max", us[n - 1]);
}

static double thread_s(void) { return app_clock_s(CLOCK_THREAD_CPUTIME_ID); }

static void time_ticks(tm_precomputed *model, double height, int ticks, cJSON *j) {
    double *update = malloc(8 * (size_t)ticks), *surface = malloc(8 * (size_t)ticks),
           *processor = malloc(8 * (size_t)ticks);
    tm_tool_pose pose[2];
    int least = 1000000;
    for (int i = -50; i < ticks; i++) { /* 10 mm/s, to and fro */
        const int k = (i + 50) % 200;
        lay(pose, height, 20e-6 * (k < 100 ? k : 200 - k));
        const double own = thread_s(), a = app_seconds();
        tm_precomputed_update(model, pose);
        const double b = app_seconds();
        tm_precomputed_displacement(model);
        const double c = app_seconds();
        if (i < 0) continue;
        processor[i] = 1e6 * (thread_s() - own);
        update[i] = 1e6 * (c - a), surface[i] = 1e6 * (c - b);
        const int rows = rows_with_force(model);
        least = rows < least ? rows : least;
    }
    quantiles(j, "update_us", update, ticks);
    quantiles(j, "superposition_us", surface, ticks);
    quantiles(j, "processor_us", processor, ticks);
    cJSON_AddNumberToObject(j, "rows_at_least", least);
    free(update), free(surface), free(processor);
}

static void on_line(const char *size, const organ *o, const tm_tissue *tissue, int ticks, cJSON *list) {
    tm_instrument_def tool[2];
    tm_tool_pose pose[2];
    lay(pose, 0.12, 0);
    for (int t = 0; t < 2; t++)
        tool[t] = (tm_instrument_def){.mode = TM_TOOL_PROBE,
                                      .radius_m = 0.0025,
                                      .contact_length_m = 0.1,
                                      .pose = pose[t],
                                      .trocar_m = {0.13, t ? 0.03 : -0.03, 0.06}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 2;
    contact.instrument = tool;
    tm_precomputed_def def = tm_precomputed_def_default();
    def.problem = kit_problem(tissue, o->fixed);
    def.contact = &contact;
    def.max_contact_vertices = 1024;
    tm_precomputed *model;
    tm_error error;
    fix_ok(tm_precomputed_create(&def, &model, NULL, &error), &error);
    double height = 0.12;
    for (int rows = 0; rows < 30 && height > 0; height -= 0.0001) { /* down until they touch with thirty rows */
        lay(pose, height, 0);
        tm_precomputed_update(model, pose);
        rows = rows_with_force(model);
    }
    cJSON *j = cJSON_CreateObject();
    cJSON_AddItemToArray(list, j);
    cJSON_AddNumberToObject(j, "tets", o->mesh->tet_count);
    time_ticks(model, height, ticks, j);
    const int32_t *surface, kept = 3 * tm_precomputed_surface(model, &surface), rows = rows_with_force(model);
    const tm_contact_row *row;
    int32_t loaded = 0, count = tm_precomputed_rows(model, &row);
    uint8_t *seen = calloc((size_t)o->mesh->vertex_count, 1);
    for (int32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            loaded += !seen[row[i].vertex[k]] && row[i].lambda_N > 0 && row[i].weight[k] > 0,
                seen[row[i].vertex[k]] |= row[i].lambda_N > 0 && row[i].weight[k] > 0;
    const double bytes = 8.0 * 3 * loaded * kept, limit = app_bandwidth_B_s((size_t)bytes, 9);
    const double p50 = cJSON_GetObjectItem(cJSON_GetObjectItem(j, "update_us"), "p50")->valuedouble,
                 p99 = cJSON_GetObjectItem(cJSON_GetObjectItem(j, "update_us"), "p99")->valuedouble;
    const double own50 = cJSON_GetObjectItem(cJSON_GetObjectItem(j, "processor_us"), "p50")->valuedouble,
                 own99 = cJSON_GetObjectItem(cJSON_GetObjectItem(j, "processor_us"), "p99")->valuedouble;
    const double sum = cJSON_GetObjectItem(cJSON_GetObjectItem(j, "superposition_us"), "p50")->valuedouble;
    cJSON_AddNumberToObject(j, "rows", rows);
    cJSON_AddNumberToObject(j, "loaded_vertices", loaded);
    cJSON_AddNumberToObject(j, "superposition_bytes", bytes);
    cJSON_AddNumberToObject(j, "bandwidth_B_s", limit);
    cJSON_AddNumberToObject(j, "share_of_bandwidth", bytes / (sum * 1e-6) / limit);
    printf("| %s | %d | %d | %.0f | %.0f | %.0f | %.0f | %.0f | %.1f MB at %.1f GB/s, %.0f %% of %.1f |\n", size, rows,
           loaded, own50, own99, p50, p99, sum, 1e-6 * bytes, bytes / sum * 1e-3, 100 * bytes / (sum * 1e-6) / limit,
           limit * 1e-9);
    fflush(stdout);
    free(seen);
    tm_precomputed_destroy(model);
}

int main(int count, char **all) {
    const char *sizes[] = {"1k", "10k", "50k"};
    const char *json = count > 1 ? all[1] : NULL;
    const int n = count > 2 && !strcmp(all[2], "--quick") ? 1 : count > 2 && !strcmp(all[2], "--10k") ? 2 : 3;
    const tm_material material = kit_material(10e3, 0.4);
    organ o[3];
    tm_tissue *tissue[3];
    cJSON *j = cJSON_CreateObject();
    cJSON_AddStringToObject(j, "commit", getenv("TM_COMMIT") ? getenv("TM_COMMIT") : "");
    cJSON_AddStringToObject(j, "flags", getenv("TM_FLAGS") ? getenv("TM_FLAGS") : "");
    cJSON *before = cJSON_AddArrayToObject(j, "ahead"), *line = cJSON_AddArrayToObject(j, "on_line");
    for (int i = 0; i < n; i++) {
        static const int32_t regions[8] = {0};
        tm_tissue_def def = tm_tissue_def_default();
        tm_error error;
        o[i] = organ_read(sizes[i]);
        def.mesh = o[i].mesh, def.material_count = 1, def.material = &material, def.region_material = regions;
        fix_ok(tm_tissue_create(&def, &tissue[i], &error), &error);
    }
    puts("Ahead of time, processor seconds (all threads together); * the columns of the first seconds, in "
         "proportion:\n\n"
         "| liver | vertices | solver | columns | order, factor s | in all s | factor MB | responses MB | work MB "
         "|\n|---|---|---|---|---|---|---|---|---|");
    const bool line_only = count > 3; /* any third argument */
    for (int i = 0; i < n && !line_only; i++)
        ahead(sizes[i], &o[i], tissue[i], TM_SOLVER_CHOLESKY, before),
            ahead(sizes[i], &o[i], tissue[i], TM_SOLVER_CG, before);
    puts("\nOn line, microseconds of one update with its superposition, two shafts lying on the organ and moving at 10 "
         "mm/s:\n\n"
         "| liver | rows | loaded vertices | processor p50 | p99 | wall p50 | p99 | superposition | it reads "
         "|\n|---|---|---|---|---|---|---|---|---|");
    for (int i = 0; i < n; i++) on_line(sizes[i], &o[i], tissue[i], 1000, line);
    for (int i = 0; i < n; i++) tm_tissue_destroy(tissue[i]), organ_free(&o[i]);
    if (json) {
        FILE *f = fopen(json, "w");
        char *text = cJSON_Print(j);
        if (!f || fputs(text, f) < 0 || fclose(f)) return perror(json), 1;
        free(text);
    }
    cJSON_Delete(j);
    return 0;
}
