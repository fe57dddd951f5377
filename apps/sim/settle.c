/* tm-sim --settle: static equilibrium and the reactions of the supports. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "observe.h"
#include "run.h"
#include "scene/models.h"

typedef struct watch {
    double tolerance, first;
    bool stopped;
} watch;

static bool on_progress(void *user, int64_t step, double residual) {
    watch *w = user;
    if (w->first == 0) w->first = residual;
    double all = log(w->first / w->tolerance), done = log(w->first / residual);
    (void)step;
    app_progress("settling", all > 0 && done > 0 ? fmin(done / all, 1) : 0, false);
    w->stopped = app_interrupted() != 0;
    return !w->stopped;
}

/* Writes u and reaction, in the file's numbering here and below. */
static void write_csv(FILE *out, const tm_mesh_file *mesh, const double *u, const double *reaction) {
    fputs("vertex,x_m,y_m,z_m,ux_m,uy_m,uz_m,rx_N,ry_N,rz_N\n", out);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const double *x = &mesh->vertex_m[3 * v], *d = &u[3 * v], *r = &reaction[3 * v];
        fprintf(out, "%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", v, x[0], x[1], x[2], d[0], d[1],
                d[2], r[0], r[1], r[2]);
    }
}

static void write_vectors(FILE *out, const char *name, const double *v, int32_t count) {
    fprintf(out, "VECTORS %s double\n", name);
    for (int32_t i = 0; i < count; i++) fprintf(out, "%.17g %.17g %.17g\n", v[3 * i], v[3 * i + 1], v[3 * i + 2]);
}

static void write_vtk(FILE *out, const sim *s, const double *u, const double *reaction) {
    const tm_mesh_file *mesh = &s->file;
    fprintf(out,
            "# vtk DataFile Version 3.0\ntm-sim: rest positions, displacement in m, support reactions in "
            "N\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %d double\n",
            mesh->vertex_count);
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        fprintf(out, "%.17g %.17g %.17g\n", mesh->vertex_m[3 * v], mesh->vertex_m[3 * v + 1],
                mesh->vertex_m[3 * v + 2]);
    fprintf(out, "CELLS %d %d\n", mesh->tet_count, 5 * mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++)
        fprintf(out, "4 %d %d %d %d\n", mesh->tet[4 * t], mesh->tet[4 * t + 1], mesh->tet[4 * t + 2],
                mesh->tet[4 * t + 3]);
    fprintf(out, "CELL_TYPES %d\n", mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) fputs("10\n", out);
    fprintf(out, "POINT_DATA %d\n", mesh->vertex_count);
    write_vectors(out, "displacement_m", u, mesh->vertex_count);
    write_vectors(out, "reaction_N", reaction, mesh->vertex_count);
    fprintf(out, "CELL_DATA %d\nSCALARS region int 1\nLOOKUP_TABLE default\n", mesh->tet_count);
    for (int32_t t = 0; t < mesh->tet_count; t++) fprintf(out, "%d\n", mesh->region[t]);
    if (s->fibre) write_vectors(out, "fibre", s->fibre, mesh->tet_count);
}

void run_support_force(const sim *s, int support, const double *reaction, double sum[3]) {
    for (int a = 0; a < 3; a++) sum[a] = 0;
    for (int32_t i = 0; i < s->fixed_count; i++)
        if (s->fixed_by[i] == support + 1) sum[s->fixed_dof[i] % 3] += reaction[s->fixed_dof[i]];
}

/* Reports one row per support: the force that it exerts on the tissue. */
static void report_supports(const sim *s, const double *reaction, cJSON *json) {
    cJSON *list = cJSON_AddArrayToObject(json, "supports");
    for (int i = 0; i < s->scene->support.count; i++) {
        const app_support *support = (const app_support *)s->scene->support.item + i;
        double sum[3];
        int count = 0;
        for (int32_t v = 0; v < s->mesh->vertex_count; v++) count += s->support_of[v] == i + 1;
        run_support_force(s, i, reaction, sum);
        char name[160];
        if (*support->name.s)
            snprintf(name, sizeof name, "%s", support->name.s);
        else
            app_scene_where(s->scene, support->here.line, name, sizeof name);
        printf("support %-24s %6d vertices   reaction %.9g %.9g %.9g N\n", name, count, sum[0], sum[1], sum[2]);
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "name", name);
        cJSON_AddNumberToObject(row, "line", support->here.line);
        cJSON_AddNumberToObject(row, "vertices", count);
        cJSON_AddItemToObject(row, "reaction_N", cJSON_CreateDoubleArray(sum, 3));
    }
}

tm_status run_insert_tools(sim *s) {
    enum { STEPS = 400 };
    if (!s->model->instrument_count) return TM_OK;
    for (int i = 0; i < s->model->instrument_count; i++) {
        tm_tool_pose outside = sim_start_pose_at(s, i, 2 * s->instrument_def[i].radius_m, s->pose[i].active);
        tm_model_set_pose(s->model, i, &outside);
    }
    tm_model_begin(s->model, s->pose, STEPS);
    return tm_model_step(s->model, STEPS);
}

/* Returns whether the model is relaxed. Then instruments take part in its equilibrium; they do not if it is solved
 * directly. */
static bool is_relaxed(const sim *s) { return !sim_models[s->scene->model.index].solves_rest; }

/* Computes the equilibrium: u and reaction [3*vertex_count]. */
static int rest(sim *s, const run_options *o, double *u, double *reaction, tm_settle_result *result) {
    tm_error error = {0};
    watch w = {.tolerance = o->tolerance};
    tm_settle_def def = tm_settle_def_default();
    def.tolerance = o->tolerance;
    def.progress = on_progress;
    def.user = &w;
    tm_status status = is_relaxed(s) ? run_insert_tools(s) : TM_OK;
    if (!status)
        status = tm_model_settle(s->model, &def, u, reaction, result, &error);
    else
        snprintf(error.message, sizeof error.message,
                 "the simulation became unstable while the instruments moved in; lower time.step_fraction");
    app_progress("settling", 1, true);
    if (w.stopped) {
        fputs("tm-sim: interrupted; nothing was written\n", stderr);
        return app_interrupted_exit();
    }
    return status ? app_report(s->scene->file, 0, &error) : 0;
}

/* Reports the tissue's static reaction on each instrument, as sent to a controller. */
static void report_tools(const sim *s, cJSON *json) {
    if (!is_relaxed(s) || !s->model->instrument_count) return;
    cJSON *list = cJSON_AddArrayToObject(json, "instruments");
    for (int i = 0; i < s->model->instrument_count; i++) {
        const tm_tool_reaction r = tm_model_reaction(s->model, i);
        printf("instrument %d: %d rows, tip force %.9g %.9g %.9g N%s\n", i, r.row_count, r.force_N[0], r.force_N[1],
               r.force_N[2],
               r.flags & TM_REACTION_INSIDE ? " (it is inside the tissue and makes no contact until it comes out)"
                                            : "");
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddNumberToObject(row, "rows", r.row_count);
        cJSON_AddItemToObject(row, "force_N", cJSON_CreateDoubleArray(r.force_N, 3));
        cJSON_AddItemToObject(row, "tip_m", cJSON_CreateDoubleArray(s->pose[i].tip_m, 3));
        cJSON_AddBoolToObject(row, "inside", r.flags & TM_REACTION_INSIDE);
    }
}

/* Reports ties: how many hold, and the sum and the largest of their forces. */
static void report_ties(const sim *s, cJSON *json) {
    const tm_ties *ties = s->model->world ? tm_world_ties(s->model->world) : NULL;
    if (!ties) return;
    double sum_N = 0, largest_N = 0;
    int32_t whole = 0, count = tm_ties_count(ties);
    for (int32_t i = 0; i < count; i++) {
        const double force_N = tm_ties_force_N(ties, i, NULL, NULL);
        whole += tm_ties_is_whole(ties, i);
        sum_N += force_N, largest_N = fmax(largest_N, force_N);
    }
    printf("ties: %d whole, %d gone, forces of %.9g N in sum, of %.9g N at most\n", whole, count - whole, sum_N,
           largest_N);
    cJSON *to = cJSON_AddObjectToObject(json, "ties");
    cJSON_AddNumberToObject(to, "whole", whole);
    cJSON_AddNumberToObject(to, "gone", count - whole);
    cJSON_AddNumberToObject(to, "force_sum_N", sum_N);
    cJSON_AddNumberToObject(to, "force_max_N", largest_N);
}

/* Writes u and reaction in the mesh's numbering. */
static int write_rest(app_file *written, const sim *s, const run_options *o, const double *u, const double *reaction) {
    const size_t n = strlen(o->write), count = 3 * (size_t)s->mesh->vertex_count;
    double *given = malloc(2 * count * sizeof *given);
    if (!given) return app_bad_input("--write", 0, "out of memory; use a smaller mesh") - 1;
    tm_mesh_to_original(s->mesh, 3, u, given);
    tm_mesh_to_original(s->mesh, 3, reaction, given + count);
    if (n > 4 && !strcmp(o->write + n - 4, ".vtk"))
        write_vtk(written->stream, s, given, given + count);
    else
        write_csv(written->stream, &s->file, given, given + count);
    free(given);
    return 0;
}

static int settle(sim *s, const run_options *o, app_file *written, cJSON *json) {
    tm_settle_result result = {0};
    size_t count = 3 * (size_t)s->mesh->vertex_count;
    double *u = calloc(2 * count, sizeof *u), *reaction = u + count;
    int rc = u ? rest(s, o, u, reaction, &result) : APP_FAILED;
    if (rc) {
        free(u);
        return rc;
    }
    double largest = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++)
        largest = fmax(largest, sqrt(u[3 * v] * u[3 * v] + u[3 * v + 1] * u[3 * v + 1] + u[3 * v + 2] * u[3 * v + 2]));
    if (is_relaxed(s))
        printf("at rest after %lld steps, residual %.3g", (long long)result.steps, result.residual);
    else
        printf("at rest, by the direct solver");
    if (result.held_friction > 0) printf(", with a friction of %.3g between bodies that slide", result.held_friction);
    printf("; energy %.9g J; largest displacement %.6g m; least det F %.3g\n", result.energy_J, largest,
           result.deformation.min_det);
    sim_shape_warn(s, &result.deformation, "at rest ");
    sim_shape_json(&result.deformation, json);
    if (s->model->world) sim_limit_report(s, tm_world_limited_tets(s->model->world), "at rest ", json);
    if (s->model->world) sim_unstable_report(s, tm_world_unstable_share(s->model->world), "at rest ", json);
    cJSON_AddNumberToObject(json, "load_steps", result.load_steps);
    cJSON_AddNumberToObject(json, "steps", (double)result.steps);
    cJSON_AddNumberToObject(json, "residual", result.residual);
    cJSON_AddNumberToObject(json, "held_friction", result.held_friction);
    cJSON_AddNumberToObject(json, "energy_J", result.energy_J);
    cJSON_AddNumberToObject(json, "largest_displacement_m", largest);
    report_supports(s, reaction, json);
    report_tools(s, json);
    run_report_touch(s, json, true);
    report_ties(s, json);
    if (written->begun) rc = write_rest(written, s, o, u, reaction);
    free(u);
    return rc;
}

int run_settle(sim *s, const run_options *o) {
    app_file written = {0}, report = {0};
    int rc = o->write ? app_output_ending("--write", o->write, ".vtk .csv") : 0;
    if (!rc) rc = app_file_begin(&written, o->write);
    if (!rc) rc = app_file_begin(&report, o->json);
    cJSON *json = run_report_begin(s, "settle");
    if (!rc) rc = settle(s, o, &written, json);
    int rc2 = app_file_end(&written, !rc);
    if (!rc) rc = rc2;
    if (rc) {
        app_file_end(&report, false);
        cJSON_Delete(json);
        return rc;
    }
    return app_file_end_json(&report, json);
}
