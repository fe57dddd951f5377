#include "observe.h"

#include <math.h>
#include <stdio.h>

#include "scene/surface_distance.h"

/* --- distance of the tools --- */

void sim_reach_note(sim *s) {
    for (int i = 0; i < s->instrument_count; i++) {
        sim_reach *r = &s->reach[i];
        const double *f = s->reaction[i].force_N;
        r->touched = r->touched || s->reaction[i].row_count > 0 || f[0] != 0 || f[1] != 0 || f[2] != 0;
        if (r->touched || !sim_has(s, "contact")) continue;
        double gap_m = sim_surface_distance(s, s->pose[i].tip_m) - s->instrument_def[i].radius_m;
        if (r->noted && gap_m >= r->gap_m) continue;
        *r = (sim_reach){.noted = true, .gap_m = gap_m, .at_s = sim_time_s(s)};
    }
}

void sim_reach_report(const sim *s, double seconds) {
    for (int i = 0; i < s->instrument_count; i++) {
        const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
        const sim_reach *r = &s->reach[i];
        double end_s = s->scene->duration.si;
        if (s->hand[i].key_count) end_s = fmin(end_s, s->hand[i].key[s->hand[i].key_count - 1].time_s);
        if (r->touched || !r->noted || seconds + s->frame_s < end_s) continue;
        char where[600];
        app_scene_where(s->scene, t->here.line, where, sizeof where);
        fprintf(stderr,
                "%s: warning: instrument %d never touched the tissue: its tip came within %.3g mm, at %.3g s; move "
                "it nearer ('above: -2 mm' is 2 mm into the surface)\n",
                where, i, 1e3 * fmax(r->gap_m, 0), r->at_s);
    }
}

/* --- deformation of the tissue --- */

/* Returns which of two shapes is reported: inverted ones first, then those with more volume beyond the linear law. */
static bool is_worse(const tm_deformation *a, const tm_deformation *b) {
    if (a->inverted != b->inverted) return a->inverted > b->inverted;
    return a->nonlinear_share > b->nonlinear_share;
}

void sim_shape_note(sim *s) {
    if (!s->model->world || s->model->condensed_tets) return;
    const int32_t limited = tm_world_limited_tets(s->model->world);
    if (limited > s->limited_tets) s->limited_tets = limited, s->limited_s = sim_time_s(s);
    const tm_deformation now = tm_tissue_deformation(s->model->tissue, tm_model_displacement(s->model));
    if (s->shape_noted && !is_worse(&now, &s->worst)) return;
    s->worst = now, s->worst_s = sim_time_s(s), s->shape_noted = true;
}

/* Warns with the line of the effect or material concerned. */
void sim_shape_warn(const sim *s, const tm_deformation *shape, const char *when) {
    char sentence[TM_ERROR_MESSAGE_MAX], where[600];
    if (!tm_tissue_check_deformation(s->model->tissue, shape, sentence)) return;
    app_scene_where(s->scene, s->scene->material.line, where, sizeof where);
    fprintf(stderr, "%s: warning: %s%s\n", where, when, sentence);
}

void sim_limit_report(const sim *s, int32_t tets, const char *when, cJSON *report) {
    static const double TOLD_SHARE = 0.01;
    const int line = sim_law_line(s->scene);
    char where[600];
    if (!line) return;
    if (report) cJSON_AddNumberToObject(report, "limited_tets", tets);
    if (!(tets > TOLD_SHARE * sim_alive(s))) return;
    app_scene_where(s->scene, line, where, sizeof where);
    fprintf(stderr,
            "%s: warning: %s%d of %d tetrahedra were beyond the limit of their law, where force grows linearly; "
            "allow a larger 'stretch:', press less, or refine the mesh there\n",
            where, when, (int)tets, (int)sim_alive(s));
}

void sim_unstable_report(const sim *s, double share, const char *when, cJSON *report) {
    static const double TOLD_SHARE = 0.005;
    const int line = sim_law_line(s->scene);
    char where[600];
    if (!line) return;
    if (report) cJSON_AddNumberToObject(report, "unstable_share", share);
    if (!(share > TOLD_SHARE)) return;
    app_scene_where(s->scene, line, where, sizeof where);
    fprintf(stderr,
            "%s: warning: %sthe law is not elliptic in %.1f %% of the volume, so that each finer mesh gives another "
            "solution; press less, or use neo-hooke, or 'slack:' for stiff fibres that are compressed\n",
            where, when, 100 * share);
}

void sim_shape_json(const tm_deformation *shape, cJSON *report) {
    cJSON *to = cJSON_AddObjectToObject(report, "deformation");
    cJSON_AddNumberToObject(to, "min_det", shape->min_det);
    cJSON_AddNumberToObject(to, "inverted", shape->inverted);
    cJSON_AddNumberToObject(to, "nonlinear_strain", shape->nonlinear_strain);
    cJSON_AddNumberToObject(to, "nonlinear_share", shape->nonlinear_share);
}

void sim_shape_report(const sim *s, cJSON *report) {
    char when[40];
    if (!s->shape_noted) return;
    snprintf(when, sizeof when, "at %.3g s ", s->worst_s);
    /* Corotational tissue recovers from crushing, as between jaws: only the report mentions that. */
    if (!sim_has(s, "rotation") && !sim_law_line(s->scene)) sim_shape_warn(s, &s->worst, when);
    if (report) sim_shape_json(&s->worst, report);
    snprintf(when, sizeof when, "at %.3g s ", s->limited_s);
    sim_limit_report(s, s->limited_tets, when, report);
}
