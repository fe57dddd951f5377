/* Output files and the JSON part common to all modes. */
#include <cjson/cJSON.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "run.h"
#include "scene/choices.h"

int run_unstable(int64_t frame) {
    fprintf(
        stderr,
        "tm-sim: frame %" PRId64
        ": a displacement stopped being finite or passed a thousand times the tissue's size, and no force was sent for "
        "it; "
        "lower time.step_fraction, or look at the materials with --explain\n",
        frame);
    return RUN_UNSTABLE;
}

int run_say_interrupted(int64_t frame, int64_t total) {
    if (!app_interrupted() || frame >= total) return APP_DONE;
    if (total == INT64_MAX) return APP_DONE; /* the usual end */
    fprintf(stderr,
            "tm-sim: interrupted after frame %" PRId64 " of %" PRId64 "; the files contain the completed frames\n",
            frame, total);
    return app_interrupted_exit();
}

/* Adds the scene's bodies, if it names any: vertices and tetrahedra [begin, end) in the numbers of the files. */
static void add_bodies(const sim *s, cJSON *report) {
    cJSON *list = s->body_count ? cJSON_AddArrayToObject(report, "bodies") : NULL;
    for (int32_t i = 0; i < s->body_count; i++) {
        const sim_body *b = s->body + i;
        cJSON *item = cJSON_CreateObject();
        cJSON_AddStringToObject(item, "name", b->name);
        cJSON_AddItemToObject(item, "vertices", cJSON_CreateIntArray((int[]){b->vertex_begin, b->vertex_end}, 2));
        cJSON_AddItemToObject(item, "tets", cJSON_CreateIntArray((int[]){b->tet_begin, b->tet_end}, 2));
        if (b->rigid) cJSON_AddTrueToObject(item, "rigid");
        cJSON *effects = NULL;
        for (int e = 0; e < sim_effect_count; e++) {
            if (!(s->scene->of_bodies >> e & 1) || !sim_body_has_effect(s->scene, i, e)) continue;
            if (!effects) effects = cJSON_AddArrayToObject(item, "effects");
            cJSON_AddItemToArray(effects, cJSON_CreateString(sim_effects[e]->name));
        }
        cJSON_AddItemToArray(list, item);
    }
}

cJSON *run_report_begin(const sim *s, const char *mode) {
    static const char *const precision[] = APP_CHOICE_LIST(APP_PRECISIONS), *const form[] =
                                                                                APP_CHOICE_LIST(APP_FORCE_FORMS);
    cJSON *r = cJSON_CreateObject();
    cJSON_AddStringToObject(r, "scene", s->scene->file);
    cJSON_AddStringToObject(r, "title", s->scene->title.s);
    cJSON_AddStringToObject(r, "mode", mode);
    cJSON_AddStringToObject(r, "version", tm_version());
    cJSON_AddStringToObject(r, "model", s->model->kind->name);
    cJSON_AddNumberToObject(r, "vertices", s->mesh->vertex_count);
    cJSON_AddNumberToObject(r, "tets", s->mesh->tet_count);
    add_bodies(s, r);
    cJSON_AddStringToObject(r, "precision", precision[s->scene->precision.index]);
    cJSON_AddStringToObject(r, "force", form[s->scene->force.index]);
    cJSON_AddNumberToObject(r, "frame_s", s->frame_s);
    cJSON_AddNumberToObject(r, "dt_s", s->dt_s);
    cJSON_AddNumberToObject(r, "substeps_per_frame", s->substeps);
    cJSON *critical = cJSON_AddObjectToObject(r, "critical_step");
    cJSON_AddNumberToObject(critical, "guaranteed_s", s->model->timing.critical_s);
    cJSON_AddNumberToObject(critical, "tet", s->model->timing.critical_tet);
    cJSON_AddNumberToObject(critical, "tet_tag", (double)s->file.tet_tag[s->model->timing.critical_tet]);
    cJSON_AddNumberToObject(r, "memory_bytes", (double)tm_memory_in_use());
    return r;
}

static void add_both(cJSON *to, const sim *s, const char *name, const double *value) {
    cJSON_AddItemToObject(to, name, cJSON_CreateDoubleArray(value, s->instrument_count));
}

static int32_t whole_ties(const tm_ties *ties) {
    int32_t whole = 0;
    for (int32_t i = 0; i < tm_ties_count(ties); i++) whole += tm_ties_is_whole(ties, i);
    return whole;
}

void run_report_ties(const sim *s, cJSON *report) {
    const tm_ties *ties = s->model->world ? tm_world_ties(s->model->world) : NULL;
    if (!ties) return;
    cJSON *to = cJSON_AddObjectToObject(report, "ties");
    cJSON_AddNumberToObject(to, "whole", whole_ties(ties));
    cJSON_AddNumberToObject(to, "gone", tm_ties_count(ties) - whole_ties(ties)); /* before --restore too */
}

static void warn_of_dropped_rows(const sim *s) {
    char where[600];
    app_scene_where(s->scene, sim_effect_line(s->scene, sim_effect_find(s->scene, "touch")), where, sizeof where);
    fprintf(
        stderr,
        "%s: warning: more surfaces were close than contact of tissue can list, so some may have passed through each "
        "other; reduce 'touch.thickness', or name 'touch.pairs'\n",
        where);
}

void run_report_touch(const sim *s, cJSON *report, bool print) {
    const tm_touching *touching = s->model->world ? tm_world_touching(s->model->world) : NULL;
    if (!touching) return;
    const tm_touching_row *row = NULL;
    const tm_touching_report now = tm_touching_get_report(touching);
    int32_t count = 0;
    double sum_N = 0;
    for (int32_t i = 0, n = tm_touching_rows(touching, &row); i < n; i++)
        count += row[i].lambda_N > 0, sum_N += row[i].lambda_N;
    if (print) printf("touch: %d rows, normal forces of %.9g N in sum\n", count, sum_N);
    if (now.overflowed) warn_of_dropped_rows(s);
    cJSON *to = cJSON_AddObjectToObject(report, "touch");
    cJSON_AddNumberToObject(to, "rows", count);
    cJSON_AddNumberToObject(to, "normal_sum_N", sum_N);
    cJSON_AddNumberToObject(to, "deepest_m", now.deepest_m);
    cJSON_AddBoolToObject(to, "overflowed", now.overflowed);
}

void run_print_ties(const sim *s) {
    if (s->ties_cut.total == 0) return;
    printf("ties: %d whole, %" PRId64 " gone, of these %" PRId64 " at their breaking load\n",
           whole_ties(tm_world_ties(s->model->world)), s->ties_cut.total, s->ties_cut.broke);
}

/* How many steps took how many substeps, and the strain from which more are taken. */
void run_report_adaptive(const sim *s, cJSON *report) {
    tm_adaptive_step a;
    if (!s->model->world || !tm_world_adaptive(s->model->world, &a)) return;
    cJSON *json = cJSON_AddObjectToObject(report, "adaptive"), *levels = cJSON_AddArrayToObject(json, "levels");
    cJSON_AddNumberToObject(json, "step_s", a.step_s);
    cJSON_AddNumberToObject(json, "substeps", 1 << a.level);
    for (int k = 0; k < a.levels; k++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(levels, row);
        cJSON_AddNumberToObject(row, "substeps", 1 << k);
        cJSON_AddNumberToObject(row, "steps", (double)a.steps[k]);
        if (isfinite(a.strain[k])) cJSON_AddNumberToObject(row, "strain_max", a.strain[k]);
    }
}

void run_report_energy(const sim *s, cJSON *report) {
    tm_energy e;
    if (!sim_has(s, "energy") || tm_world_energy(s->model->world, &e, NULL)) return;
    const struct {
        const char *name;
        double value;
    } row[] = {{"kinetic_J", e.kinetic_J},
               {"elastic_J", e.elastic_J},
               {"start_J", e.start_J},
               {"support_J", e.support_J},
               {"gravity_J", e.gravity_J},
               {"load_J", e.load_J},
               {"state_change_J", e.state_change_J},
               {"damping_J", e.damping_J},
               {"cut_J", e.cut_J},
               {"residual_J", e.residual_J},
               {"drag_J", e.drag_J},
               {"friction_J", e.friction_J},
               {"touch_J", e.touch_J},
               {"touch_stored_J", e.touch_stored_J},
               {"contact_stored_J", e.contact_stored_J},
               {"generated_J", e.generated_J}};
    cJSON *to = cJSON_AddObjectToObject(report, "energy");
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) cJSON_AddNumberToObject(to, row[i].name, row[i].value);
    add_both(to, s, "contact_J", e.contact_J);
    add_both(to, s, "grasp_J", e.grasp_J);
    add_both(to, s, "tool_work_J", e.tool_work_J);
}

/* Returns whether the compliance of patches belongs to a tangent, which the tissue moves away from. */
static bool ages(const sim *s) { return sim_has(s, "rotation") || sim_law_line(s->scene); }

void run_report_coverage(const sim *s, cJSON *report) {
    static const char *const what[] = {"force", "stiffness", "patch"}; /* in the order of sim_sends */
    if (s->can_send == SIM_SENDS_FORCE) return;
    cJSON *list = cJSON_AddArrayToObject(report, "coverage");
    for (int i = 0; i < s->instrument_count; i++) {
        const sim_coverage *of = &s->coverage[i];
        cJSON *to = cJSON_CreateObject();
        cJSON_AddStringToObject(to, "of", what[s->can_send]);
        cJSON_AddNumberToObject(to, "touched", (double)of->touched);
        cJSON_AddNumberToObject(to, "carried", (double)of->carried);
        if (s->can_send == SIM_SENDS_PATCH && ages(s)) cJSON_AddNumberToObject(to, "age_max", of->age_max);
        cJSON_AddItemToArray(list, to);
        if (of->age_max > 0 && !app_is_quiet())
            printf("patches of instrument %d: compliance at most %.2g %% off the tangent's (age)\n", i,
                   100 * of->age_max);
    }
}
