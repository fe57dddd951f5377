/* tm-sim --explain: the stages of one step of this scene, the effects that require them, their memory and cost, and
 * what is absent. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "explain_mass.h"
#include "explain_numbering.h"
#include "explain_stream.h"
#include "hrt.h"
#include "json_file.h"
#include "run.h"
#include "scene/effects.h"
#include "study_summary.h"

enum { ROWS = TM_MAX_STAGES + SIM_MAX_EFFECTS };

typedef struct row {
    char name[32], asked[300];
    const char *phase;
    const char *threads;  /* whether the step's threads share the stage */
    const char *provider; /* of "force": stage that provides its law, or null */
    int line;
    int64_t bytes;
    double us_per_step;
    int effect;          /* effect that its time is counted for; -1: none */
    bool timed, in_step; /* timed, but not in the step: runs between frames, its time divided by the steps */
} row;

static const char *const phase_name[] = {"begin", "force", "load", "integrate", "constrain", "end", "on demand"};

/* Returns the bytes of the scene's tissue without some features; -1 if it cannot be built. */
static int64_t tissue_with(const sim *s, bool fibres, bool cutting, bool volume) {
    tm_tissue_def def = s->def.model.tissue;
    tm_tissue *plain;
    tm_error error = {0};
    tm_material *isotropic = malloc(sizeof *isotropic * (size_t)def.material_count);
    if (!isotropic) return -1;
    memcpy(isotropic, def.material, sizeof *isotropic * (size_t)def.material_count);
    for (int i = 0; i < def.material_count && !fibres; i++)
        isotropic[i].dlambda_Pa = isotropic[i].dmu_Pa = isotropic[i].beta_Pa = 0;
    if (!fibres) {
        def.material = isotropic;
        def.fibre = NULL;
    }
    if (!cutting) def.cuttable = false;
    if (!volume) def.strain_smoothing = false;
    int64_t bytes = -1;
    if (!tm_tissue_create(&def, &plain, &error)) {
        bytes = tm_tissue_bytes(plain);
        tm_tissue_destroy(plain);
    }
    free(isotropic);
    return bytes;
}

/* Attributes the tissue's bytes to effects. */
static void share_tissue(const sim *s, int64_t part[SIM_PART_COUNT]) {
    const bool cutting = s->def.model.tissue.cuttable, volume = s->def.model.tissue.strain_smoothing;
    const int64_t all = s->fibre || cutting || volume ? tissue_with(s, true, true, false) : -1;
    const int64_t unfibred = all >= 0 && s->fibre ? tissue_with(s, false, true, false) : -1;
    const int64_t uncut = all >= 0 && cutting ? tissue_with(s, true, false, false) : -1;
    part[SIM_PART_FIBRES] = unfibred >= 0 ? all - unfibred : 0;
    part[SIM_PART_CUTTING] = uncut >= 0 ? all - uncut : 0;
    part[SIM_PART_SMOOTHING] = all >= 0 && volume ? tm_tissue_bytes(s->model->tissue) - all : 0;
}

static int line_of_stage(const sim *s, int owner) {
    if (owner == SIM_OWNER_SUPPORTS) return s->scene->support.line;
    if (owner == SIM_OWNER_LOADS) return s->scene->load.line;
    return owner >= 0 ? sim_effect_line(s->scene, owner) : s->scene->tissue.line;
}

/* Runs steps for about 0.3 s with timers on. */
static tm_status measure(sim *s, tm_stage_report *report, int *count) {
    tm_stage_report before[TM_MAX_STAGES];
    for (int i = 0; i < s->instrument_count; i++) s->wants[i] = s->can_send; /* the costliest possible contents */
    tm_status status = sim_frame(s, s->pose, s->substeps);                   /* warm-up */
    tm_model_set_timing(s->model, true);
    tm_model_stages(s->model, before);
    int64_t begin = app_monotonic_us();
    for (int i = 0; !status && (i < 1 || app_monotonic_us() - begin < 300000) && i < 100000 && !app_interrupted(); i++)
        status = sim_frame(s, s->pose, s->substeps);
    *count = tm_model_stages(s->model, report);
    for (int i = 0; i < *count; i++) {
        report[i].runs -= before[i].runs;
        report[i].seconds -= before[i].seconds;
    }
    return status;
}

static int gather(const sim *s, const tm_stage_report *report, int count, row *rows) {
    int n = 0;
    rows[n] =
        (row){.name = "mesh", .phase = "", .effect = -1, .line = app_mesh_line(s->scene), .bytes = s->mesh->bytes};
    app_scene_where(s->scene, rows[n].line, rows[n].asked, sizeof rows[n].asked);
    n++;
    int64_t part[SIM_PART_COUNT] = {0};
    share_tissue(s, part);
    rows[n] = (row){.name = "tissue",
                    .phase = "",
                    .effect = -1,
                    .line = s->scene->tissue.line,
                    .bytes = tm_tissue_bytes(s->model->tissue) - part[SIM_PART_FIBRES] - part[SIM_PART_CUTTING] -
                             part[SIM_PART_SMOOTHING]};
    app_scene_where(s->scene, rows[n].line, rows[n].asked, sizeof rows[n].asked);
    n++;
    /* Memory of an effect outside its stages: counted by the library, or within the tissue. */
    int64_t beside[SIM_MAX_EFFECTS];
    for (int e = 0; e < sim_effect_count; e++) beside[e] = s->cost[e].bytes + part[sim_effects[e]->part];
    for (int i = 0; i < count; i++) {
        int owner = SIM_OWNER_ALL;
        for (int j = 0; j < s->owner_count; j++)
            if (!strcmp(s->owner[j].stage, report[i].name)) owner = s->owner[j].effect;
        rows[n] = (row){.phase = phase_name[report[i].phase],
                        .effect = owner >= 0 ? owner : -1,
                        .line = line_of_stage(s, owner),
                        .bytes = report[i].bytes,
                        .timed = true,
                        .in_step = report[i].phase != TM_PHASE_ON_DEMAND,
                        .threads = report[i].overlaps  ? "overlap"
                                   : report[i].divided ? "divided"
                                                       : "",
                        .provider = report[i].provider,
                        .us_per_step = report[i].runs ? report[i].seconds * 1e6 / (double)report[i].runs : 0};
        if (owner >= 0) {
            rows[n].bytes += beside[owner];
            beside[owner] = 0;
        }
        snprintf(rows[n].name, sizeof rows[n].name, "%s", report[i].name);
        app_scene_where(s->scene, rows[n].line, rows[n].asked, sizeof rows[n].asked);
        n++;
    }
    /* Effects without a stage of their own. */
    for (int e = 0; e < sim_effect_count; e++) {
        bool staged = false;
        for (int j = 0; j < s->owner_count; j++) staged |= s->owner[j].effect == e;
        if (!sim_effect_line(s->scene, e) || staged) continue;
        rows[n] = (row){.phase = "", .effect = e, .line = sim_effect_line(s->scene, e), .bytes = beside[e]};
        snprintf(rows[n].name, sizeof rows[n].name, "%s", sim_effects[e]->name);
        app_scene_where(s->scene, rows[n].line, rows[n].asked, sizeof rows[n].asked);
        n++;
    }
    return n;
}

static double expected_of(const sim *s, const sim_expected *x, const row *r) {
    if (!strcmp(r->name, "mesh")) return x->error;
    if (r->effect < 0) return NAN;
    const char *name = sim_effects[r->effect]->name;
    if (strcmp(name, "haptics")) return sim_expected_without(x, name);
    const sim_haptics *o = sim_options(s->scene, name);
    return sim_expected_felt(x, hrt_extrapolator_name((hrt_extrapolator)o->extrapolator.index), 1 / s->sample_s);
}

/* Formats the study's column, if there is a study. */
static void expected_text(const sim *s, const sim_expected *x, const row *r, cJSON *json, char text[16]) {
    text[0] = 0;
    if (!x->study) return;
    const double error = expected_of(s, x, r);
    if (isfinite(error)) cJSON_AddNumberToObject(json, "expected_error", error);
    if (isfinite(error))
        snprintf(text, 16, "%13.3g%% ", 100 * error);
    else
        snprintf(text, 16, "%14s ", "-");
}

static void explain_fade(const sim *s, cJSON *json) {
    const double fade_s = s->def.model.cut ? s->def.model.cut->fade_s : 0;
    cJSON_AddNumberToObject(json, "cut_fade_s", fade_s);
    if (!(fade_s > 0)) return;
    char where[300];
    app_scene_where(s->scene, sim_effect_line(s->scene, sim_effect_find(s->scene, "cut")), where, sizeof where);
    printf("cut.fade: the force from a removed tetrahedron falls to 0 within %.4g ms (%s)\n\n", 1e3 * fade_s, where);
}

static void explain_bodies(const sim *s) {
    for (int32_t i = 0; i < s->body_count; i++) {
        printf("body %s: tetrahedra %d to %d, vertices %d to %d of the files", s->body[i].name, s->body[i].tet_begin,
               s->body[i].tet_end - 1, s->body[i].vertex_begin, s->body[i].vertex_end - 1);
        const char *before = "; effects of its own: ";
        for (int e = 0; e < sim_effect_count; e++) {
            if (!(s->scene->of_bodies >> e & 1) || !sim_body_has_effect(s->scene, i, e)) continue;
            printf("%s%s", before, sim_effects[e]->name);
            before = ", ";
        }
        printf("\n");
    }
    if (s->body_count) printf("\n");
}

static void explain_ties(const sim *s, cJSON *json) {
    const tm_ties *ties = s->model->world ? tm_world_ties(s->model->world) : NULL;
    if (!ties) return;
    cJSON_AddNumberToObject(json, "ties", tm_ties_count(ties));
    printf("ties: %d\n\n", tm_ties_count(ties));
}

static void explain_adaptive(const sim *s, cJSON *json) {
    tm_adaptive_step a;
    if (!s->model->world || !tm_world_adaptive(s->model->world, &a)) return;
    char where[300];
    app_scene_where(s->scene, s->scene->adaptive.line, where, sizeof where);
    run_report_adaptive(s, json);
    printf("time.adaptive (%s): substeps of %.4g s up to a strain of %.3g", where, a.step_s, a.strain[0]);
    for (int k = 1; k < a.levels - 1; k++) printf(", a %dth of it up to %.3g", 1 << k, a.strain[k]);
    if (a.levels > 1) printf(", a %dth beyond", 1 << (a.levels - 1));
    printf("\n\n");
}

static void explain_times(const sim *s, cJSON *json) {
    explain_fade(s, json);
    explain_adaptive(s, json);
}

static void print_head(const sim *s) {
    tm_mass_scaling added;
    char setter[SIM_TET_NAME];
    const bool scaled = tm_tissue_mass_scaling(s->model->tissue, &added) && added.vertices > 0;
    if (scaled)
        snprintf(setter, sizeof setter, "%d", s->scene->mass_scaling.line);
    else
        sim_tet_name(s, s->model->timing.critical_tet, setter);
    printf("%s: %d tetrahedra, %d vertices; %.4g frames/s of %d substep%s of %.4g s (guaranteed critical step %.4g s, "
           "set by %s %s)\n\n",
           s->scene->file, s->mesh->tet_count, s->mesh->vertex_count, 1 / s->frame_s, s->substeps,
           s->substeps == 1 ? "" : "s", s->dt_s, s->model->timing.critical_s,
           scaled ? "time.mass_scaling, line" : "tetrahedron", setter);
}

static void print(const sim *s, const row *rows, int n, double total_us, const sim_expected *x, cJSON *json) {
    print_head(s);
    const int32_t threads = s->model->world ? tm_world_partitions(s->model->world) : 1;
    if (s->scene->threads.line)
        printf("threads: %d of %lld requested%s\n\n", threads, (long long)s->scene->threads.value,
               threads < s->scene->threads.value ? "; the tissue is too small for more" : "");
    cJSON_AddNumberToObject(json, "threads", threads);
    explain_stream(s, json);
    explain_numbering(s, json);
    explain_mass(s, json);
    explain_times(s, json);
    printf("%-18s %-10s %-8s %12s %10s %7s %s requested by\n", "stage", "phase", "threads", "bytes", "us/step", "share",
           x->study ? "expected error" : "");
    cJSON *list = cJSON_AddArrayToObject(json, "stages");
    for (int i = 0; i < n; i++) {
        double share = total_us > 0 ? rows[i].us_per_step / total_us : 0;
        cJSON *j = cJSON_CreateObject();
        cJSON_AddItemToArray(list, j);
        cJSON_AddStringToObject(j, "name", rows[i].name);
        cJSON_AddStringToObject(j, "phase", rows[i].phase);
        cJSON_AddNumberToObject(j, "line", rows[i].line);
        cJSON_AddStringToObject(j, "asked_by", rows[i].asked);
        if (rows[i].timed) cJSON_AddStringToObject(j, "threads", rows[i].threads);
        if (rows[i].provider) cJSON_AddStringToObject(j, "law_of", rows[i].provider);
        cJSON_AddNumberToObject(j, "bytes", (double)rows[i].bytes);
        cJSON_AddBoolToObject(j, "in_step", rows[i].in_step);
        char expected[16];
        expected_text(s, x, &rows[i], j, expected);
        if (rows[i].timed) {
            cJSON_AddNumberToObject(j, "us_per_step", rows[i].us_per_step);
            cJSON_AddNumberToObject(j, "share", share);
            printf("%-18s %-10s %-8s %12lld %10.3f %6.1f%% %s %s%s%s\n", rows[i].name, rows[i].phase, rows[i].threads,
                   (long long)rows[i].bytes, rows[i].us_per_step, 100 * share, expected, rows[i].asked,
                   rows[i].provider ? "; law of " : "", rows[i].provider ? rows[i].provider : "");
        } else
            printf("%-18s %-10s %-8s %12lld %10s %7s %s %s\n", rows[i].name, rows[i].phase, "",
                   (long long)rows[i].bytes, "-", "-", expected, rows[i].asked);
    }
    double real = total_us > 0 ? s->dt_s * 1e6 / total_us : 0;
    printf("\none step %.3f us: %.2f simulated seconds a second on this machine now\nnot in the scene, without cost:",
           total_us, real);
    cJSON_AddNumberToObject(json, "us_per_step", total_us);
    cJSON_AddNumberToObject(json, "sim_seconds_per_wall_second", real);
    cJSON *left = cJSON_AddArrayToObject(json, "left_out");
    int left_count = 0;
    for (int e = 0; e < sim_effect_count; e++)
        if (!sim_effect_line(s->scene, e)) {
            printf(" %s", sim_effects[e]->name);
            left_count++;
            cJSON_AddItemToArray(left, cJSON_CreateString(sim_effects[e]->name));
        }
    puts(left_count ? "" : " nothing");
}

/* Prints the meaning of the study's column. */
static void print_expected(const sim_expected *x, cJSON *json) {
    if (!x->study) return;
    cJSON *out = cJSON_AddObjectToObject(json, "expected_error");
    cJSON_AddStringToObject(out, "study", x->file);
    cJSON_AddNumberToObject(out, "force", x->error);
    if (isfinite(x->uncertainty)) cJSON_AddNumberToObject(out, "uncertainty", x->uncertainty);
    printf("expected error of the force at the hand, by %s. Mesh: error of the present scene", x->file);
    if (isfinite(x->uncertainty)) printf(" (the reference solution is uncertain by %.2g %%)", 100 * x->uncertainty);
    puts("; effect: change if it is left out; haptics: error of the extrapolator between frames");
    const char *law;
    const double other = sim_expected_law(x, &law), mass = sim_expected_mass(x);
    if (isfinite(other)) {
        printf("law of large strains: '%s' changes the force by %.3g %%\n", law, 100 * other);
        cJSON_AddStringToObject(out, "other_law", law);
        cJSON_AddNumberToObject(out, "other_law_change", other);
    }
    if (!isfinite(mass)) return;
    printf("mass scaling changes the force by %.3g %%\n", 100 * mass);
    cJSON_AddNumberToObject(out, "mass_scaling", mass);
}

int run_explain(sim *s, const run_options *o) {
    app_file report = {0};
    row rows[ROWS];
    tm_stage_report stages[TM_MAX_STAGES];
    int count = 0, rc = app_file_begin(&report, o->json);
    if (rc) return rc;
    cJSON *json = run_report_begin(s, "explain");
    tm_status status = measure(s, stages, &count);
    double total_us = 0;
    int n = gather(s, stages, count, rows);
    for (int i = 0; i < n; i++) total_us += rows[i].us_per_step;
    if (status || app_interrupted()) {
        fputs(status ? "tm-sim: the scene blew up while being measured; lower time.step_fraction\n"
                     : "tm-sim: interrupted; nothing was measured\n",
              stderr);
        app_file_end(&report, false);
        cJSON_Delete(json);
        return status ? APP_FAILED : app_interrupted_exit();
    }
    sim_expected expected;
    sim_expected_open(&expected, s);
    explain_bodies(s);
    explain_ties(s, json);
    print(s, rows, n, total_us, &expected, json);
    print_expected(&expected, json);
    sim_expected_close(&expected);
    return app_file_end_json(&report, json);
}
