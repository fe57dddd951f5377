/* Queries of effects, models and run modes about a scene and its simulation. Independent of each of them. */
#include "sim.h"

#include <math.h>
#include <string.h>

#include "effects.h"
#include "models.h"

tm_status sim_report(const app_scene *scene, int line, const tm_error *error) {
    if (line < 0)
        return app_scene_fail(scene, line, error->status ? error->status : TM_ERR_ARGUMENT, "%s", error->message);
    return app_host_report(&scene->host, scene->file, line, error);
}

tm_status sim_report_file(const app_scene *scene, int line, const char *file, int file_line, const tm_error *error) {
    tm_error whole = *error;
    char where[600];
    app_scene_where(scene, line, where, sizeof where);
    size_t used = strlen(whole.message);
    snprintf(whole.message + used, sizeof whole.message - used, " (the scene names it: %s)", where);
    return app_host_report(&scene->host, file, file_line, &whole);
}

int sim_effect_find(const app_scene *scene, const char *name) {
    for (int i = 0; i < scene->effect_count; i++)
        if (!strcmp(scene->effect_key[i].name, name)) return i;
    return -1;
}

int sim_effect_line(const app_scene *scene, int index) {
    const int model = scene->effect_key[index].model;
    if (model) return scene->model.index == model ? scene->model.line : 0;
    return ((const app_section *)scene->effect[index])->line;
}

const void *sim_options(const app_scene *scene, const char *effect) {
    const int i = sim_effect_find(scene, effect);
    return i >= 0 && sim_effect_line(scene, i) ? scene->effect[i] : NULL;
}

int sim_law_line(const app_scene *scene) {
    const app_material *m = scene->material.item;
    for (int i = 0; i < scene->material.count; i++)
        if (m[i].law.index != TM_LAW_LINEAR) return m[i].law.line ? m[i].law.line : m[i].region.line;
    return 0;
}

/* --- effects of single bodies --- */

bool sim_body_has_effect(const app_scene *scene, int body, int effect) {
    const app_body *b = (const app_body *)scene->body.item + body;
    if (!sim_effect_line(scene, effect)) return false;
    if (!(scene->of_bodies >> effect & 1)) return true;
    return b->effects.options && ((const app_section *)b->effects.options[effect])->line;
}

bool sim_effect_everywhere(const app_scene *scene, int effect) {
    const app_body *body = scene->body.item;
    for (int b = 0; b < scene->body.count; b++)
        if (!body[b].rigid.on && !sim_body_has_effect(scene, b, effect)) return false;
    return true;
}

bool sim_effects_meet(const app_scene *scene, const char *a, const char *b) {
    const int i = sim_effect_find(scene, a), j = sim_effect_find(scene, b);
    if (!sim_effect_line(scene, i) || !sim_effect_line(scene, j)) return false;
    bool meet = !scene->body.count;
    for (int k = 0; k < scene->body.count; k++)
        meet = meet || (sim_body_has_effect(scene, k, i) && sim_body_has_effect(scene, k, j));
    return meet;
}

bool sim_has(const sim *s, const char *effect) { return sim_options(s->scene, effect) != NULL; }

tm_surface_view sim_surface(const sim *s) { return tm_model_surface(s->model); }
const double *sim_displacement(const sim *s) { return tm_model_displacement(s->model); }
double sim_time_s(const sim *s) { return tm_model_time_s(s->model); }
int32_t sim_alive(const sim *s) { return tm_model_alive(s->model); }
uint64_t sim_hash(const sim *s) { return tm_model_hash(s->model); }

/* `auto`: devices render no faster, and the extrapolator has nothing left to predict. */
static const double top_Hz = 500;
/* Maximum rate with patches: one takes some milliseconds. */
static const double patch_rate_max_Hz = 50;

int32_t sim_stream_per_frame(const app_scene *scene) {
    const sim_haptics *haptics = sim_options(scene, "haptics");
    if (!haptics || scene->pace == SIM_FRAMES) return 1;
    const bool automatic = haptics->rate.si == 0;
    const double wanted = (automatic ? top_Hz : haptics->rate.si) / scene->frame_rate.si;
    const int32_t count = (int32_t)(automatic ? floor(wanted + 1e-9) : round(wanted));
    return count > 1 ? count : 1;
}

sim_sends sim_stream_sends_by_rate(double rate_Hz) {
    return rate_Hz <= patch_rate_max_Hz * (1 + 1e-9) ? SIM_SENDS_PATCH : SIM_SENDS_FORCE;
}

sim_sends sim_stream_sends(const sim *s, double rate_Hz) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    const bool frames = s->scene->pace == SIM_FRAMES;
    return !haptics || haptics->sends.line || frames ? SIM_SENDS_PATCH : sim_stream_sends_by_rate(rate_Hz);
}

/* --- the scene's line that caused a model's failure --- */

/* Returns the line of the scene that set a member of tm_model_def. */
static int line_of(const app_scene *scene, const char *member) {
    const struct {
        const char *member;
        int line;
    } row[] = {
        {"tissue", scene->tissue.line},       {"support", scene->support.line},
        {"load", scene->load.line},           {"pressure", scene->load.line},
        {"precision", scene->precision.line}, {"frame_s", scene->step.line ? scene->step.line : scene->material.line},
        {"step_s", scene->step.line},         {"adaptive", scene->adaptive.line}};
    for (size_t i = 0; member && i < sizeof row / sizeof *row; i++)
        if (!strcmp(row[i].member, member)) return row[i].line;
    const int effect = member ? sim_effect_find(scene, member) : -1;
    return effect >= 0 ? sim_effect_line(scene, effect) : scene->model.line;
}

const char *sim_tet_name(const sim *s, int32_t tet, char name[SIM_TET_NAME]) {
    int32_t i = 0;
    while (i < s->body_count && tet >= s->body[i].tet_end) i++;
    snprintf(name, SIM_TET_NAME, i < s->body_count ? "%lld of body %.40s" : "%lld", (long long)s->file.tet_tag[tet],
             i < s->body_count ? s->body[i].name : "");
    return name;
}

tm_status sim_check_model(const sim *s, tm_status status, const tm_error *error) {
    const char *invalid_member = s->def.invalid_member ? s->def.invalid_member : "";
    const int line = line_of(s->scene, invalid_member);
    char name[SIM_TET_NAME];
    if (status == TM_OK) return TM_OK;
    if (!strcmp(invalid_member, "precision"))
        return app_scene_bad(
            s->scene, line,
            "tissue.precision = single needs supports that hold every piece, as rounded tensors would make it rotate: %s, or write 'precision: double'",
            error->message);
    if (s->scene->mass_scaling.on && !strcmp(invalid_member, "tissue") &&
        (status == TM_ERR_LIMIT || status == TM_ERR_EXCLUDED))
        return app_scene_bad(s->scene, s->scene->mass_scaling.line,
                             "time.mass_scaling: %s (time.step, time.mass_scaling_max)", error->message);
    if ((status == TM_ERR_STEP || status == TM_ERR_LIMIT) && error->entity >= 0)
        return app_scene_bad(s->scene, line, "%s (tetrahedron %s, in its mesh file; tm-mesh info)", error->message,
                             sim_tet_name(s, (int32_t)error->entity, name));
    return sim_report(s->scene, line, error);
}
