/* What is valid and probably not meant: units, supports, tools that cannot touch. */
#include <math.h>

#include "effects.h"
#include "scene_parts.h"
#include "stream.h"
#include "surface.h"

/* Brain, the softest organ, has some 500 Pa; bone 2e10. */
static const double softest_Pa = 50, largest_organ_m = 2, smallest_organ_m = 1e-3, longest_shaft_m = 0.5;

static void bounds(const tm_mesh *mesh, double low[3], double high[3]) {
    for (int a = 0; a < 3; a++) low[a] = INFINITY, high[a] = -INFINITY;
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], mesh->rest_m[i]);
        high[i % 3] = fmax(high[i % 3], mesh->rest_m[i]);
    }
}

static int warn_size(const sim *s) {
    double low[3], high[3], size = 0;
    bounds(s->mesh, low, high);
    for (int a = 0; a < 3; a++) size = fmax(size, high[a] - low[a]);
    int line = s->scene->scale.line ? s->scene->scale.line : s->scene->mesh.line;
    if (size > largest_organ_m)
        return app_scene_warn(s->scene, line,
                              "the mesh is %.4g m across; if its file is in millimetres, write tissue.scale: %g", size,
                              1e-3 * s->scene->scale.si);
    if (size < smallest_organ_m)
        return app_scene_warn(s->scene, line, "the mesh is %.4g mm across; look at tissue.scale (metres per unit)",
                              1e3 * size);
    return 0;
}

static int warn_materials(const sim *s) {
    bool fibred = false;
    int rc = 0;
    for (int i = 0; i < s->scene->material.count && !rc; i++) {
        const app_material *m = (const app_material *)s->scene->material.item + i;
        const app_number *stiffness[] = {&m->young, &m->mu, &m->mu_T, &m->mu_L, &m->E_L, &m->E_T, &m->G_L};
        app_law law = APP_LAW_YOUNG;
        app_scene_law(s->scene, m, &law);
        fibred |= app_law_fibred(law);
        for (int k = 0; k < 7 && !rc; k++)
            if (stiffness[k]->line && stiffness[k]->si < softest_Pa)
                rc = app_scene_warn(s->scene, stiffness[k]->line,
                                    "%g Pa is softer than any tissue; a number without a unit is in Pa: write kPa if "
                                    "that is meant",
                                    stiffness[k]->si);
    }
    const int index = sim_effect_find(s->scene, "anisotropy"), line = index < 0 ? 0 : sim_effect_line(s->scene, index);
    if (!rc && line && !fibred)
        rc = app_scene_warn(s->scene, line,
                            "fibres, but every material is isotropic: they change nothing; give one of them lambda_T "
                            "mu_T lambda_L mu_L or E_L E_T nu_LT nu_TT G_L, or leave 'anisotropy:' out");
    return rc;
}

static int warn_supports(const sim *s) {
    const int index = sim_effect_find(s->scene, "gravity");
    if (s->scene->support.count || index < 0 || !sim_effect_line(s->scene, index)) return 0;
    return app_scene_warn(s->scene, sim_effect_line(s->scene, index),
                          "nothing holds the tissue: it falls for ever; add 'supports:'");
}

static int warn_instrument(const sim *s, int i) {
    const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
    double low[3], high[3], away = 0;
    bounds(s->mesh, low, high);
    for (int a = 0; a < 3; a++) {
        double d = fmax(fmax(low[a] - t->trocar.v[a], t->trocar.v[a] - high[a]), 0);
        away += d * d;
    }
    if (sqrt(away) > longest_shaft_m)
        return app_scene_warn(s->scene, t->trocar.line,
                              "the trocar of instrument %d is %.3g m from the tissue, its shaft %g m long; move it, or "
                              "look at units",
                              i, sqrt(away), longest_shaft_m);
    if (sim_has(s, "contact") && sim_is_inside(s->mesh, s->pose[i].tip_m))
        return app_scene_warn(s->scene, t->start_here.line ? t->start_here.line : t->here.line,
                              "instrument %d starts inside the tissue and touches nothing until it has come out; start "
                              "it outside ('above: 5 mm')",
                              i);
    return 0;
}

int sim_warn(const sim *s) {
    int rc = warn_size(s);
    if (!rc) rc = warn_materials(s);
    if (!rc) rc = warn_supports(s);
    if (!rc && s->instrument_count && !sim_has(s, "contact"))
        rc = app_scene_warn(s->scene, s->scene->instrument.line,
                            "instruments that touch nothing: the scene does not name the effect; add 'contact:'");
    for (int i = 0; i < s->instrument_count && !rc; i++) rc = warn_instrument(s, i);
    return rc;
}

enum { MANY_SUBSTEPS = 20000, MOST_SUBSTEPS = 10000000 }; /* a frame: slow; refused */

/* A frame has a whole number of force samples. */
static int warn_rate(const sim *s) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    if (!haptics || haptics->rate.si == 0 || s->scene->pace == SIM_FRAMES) return 0;
    const double asked_Hz = haptics->rate.si, rate_Hz = s->samples * s->scene->frame_rate.si;
    if (fabs(rate_Hz - asked_Hz) <= 0.01 * asked_Hz) return 0;
    return app_scene_warn(s->scene, haptics->rate.line,
                          "haptics.rate = %.4g Hz is no multiple of time.frame_rate = %.4g Hz; forces are sent at %.4g "
                          "Hz: choose a multiple",
                          asked_Hz, s->scene->frame_rate.si, rate_Hz);
}

int sim_warn_pace(const sim *s) {
    const tm_pace *pace = &s->model->pace;
    const int rc = warn_rate(s);
    if (rc) return rc;
    const int line = s->scene->step.line ? s->scene->step.line : s->scene->material.line;
    const double substeps = (double)s->samples * pace->substeps;
    if (substeps > MOST_SUBSTEPS) /* the model refuses as many of a force sample */
        return app_scene_bad(s->scene, line,
                             "a frame would take %.3g substeps of %.3g s, set by tetrahedron %lld; look at its "
                             "material (Young's modulus, density) and its shape (tm-mesh info)",
                             substeps, pace->dt_s, (long long)s->file.tet_tag[pace->critical_tet]);
    if (substeps <= MANY_SUBSTEPS) return 0;
    return app_scene_warn(s->scene, line,
                          "a frame takes %.3g substeps of %.3g s, set by tetrahedron %lld; look at its material "
                          "(Young's modulus, density) and its shape (tm-mesh info)",
                          substeps, pace->dt_s, (long long)s->file.tet_tag[pace->critical_tet]);
}

/* --- how near it came --- */

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
                "%s: warning: instrument %d never touched the tissue: its tip came within %.3g mm, at %.3g s; lead it "
                "nearer ('above: -2 mm' is 2 mm into the surface)\n",
                where, i, 1e3 * fmax(r->gap_m, 0), r->at_s);
    }
}

/* --- how far it was deformed --- */

/* Of two shapes the one to be told: inside out before not, then what the linear law leaves out of most of the volume.
 */
static bool is_worse(const tm_deformation *a, const tm_deformation *b) {
    if (a->inverted != b->inverted) return a->inverted > b->inverted;
    return a->nonlinear_share > b->nonlinear_share;
}

void sim_shape_note(sim *s) {
    if (!s->model->world || s->model->condensed_tets) return;
    const tm_deformation now = tm_tissue_deformation(s->model->tissue, tm_model_displacement(s->model));
    if (s->shape_noted && !is_worse(&now, &s->worst)) return;
    s->worst = now, s->worst_s = sim_time_s(s), s->shape_noted = true;
}

/* With the line of the effect or material to look at. */
void sim_shape_warn(const sim *s, const tm_deformation *shape, const char *when) {
    char sentence[TM_ERROR_MESSAGE_MAX], where[600];
    if (!tm_tissue_doubts(s->model->tissue, shape, sentence)) return;
    app_scene_where(s->scene, s->scene->material.line, where, sizeof where);
    fprintf(stderr, "%s: warning: %s%s\n", where, when, sentence);
}

void sim_shape_json(const tm_deformation *shape, cJSON *report) {
    cJSON *to = cJSON_AddObjectToObject(report, "deformation");
    cJSON_AddNumberToObject(to, "least_det", shape->least_det);
    cJSON_AddNumberToObject(to, "inverted", shape->inverted);
    cJSON_AddNumberToObject(to, "nonlinear_strain", shape->nonlinear_strain);
    cJSON_AddNumberToObject(to, "nonlinear_share", shape->nonlinear_share);
}

void sim_shape_report(const sim *s, cJSON *report) {
    char when[40];
    if (!s->shape_noted) return;
    snprintf(when, sizeof when, "at %.3g s ", s->worst_s);
    /* Tissue that turns gets over being crushed, as between jaws: of that a run tells in its report alone. */
    if (!sim_has(s, "rotation")) sim_shape_warn(s, &s->worst, when);
    if (report) sim_shape_json(&s->worst, report);
}
