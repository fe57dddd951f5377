/* What effects, models and modes ask of a scene and its simulation. Knows none of them. */
#include "sim.h"

#include <string.h>

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

bool sim_has(const sim *s, const char *effect) { return sim_options(s->scene, effect) != NULL; }

tm_surface_view sim_surface(const sim *s) { return tm_model_surface(s->model); }
const double *sim_displacement(const sim *s) { return tm_model_displacement(s->model); }
double sim_time_s(const sim *s) { return tm_model_time_s(s->model); }
int32_t sim_alive(const sim *s) { return tm_model_alive(s->model); }
uint64_t sim_hash(const sim *s) { return tm_model_hash(s->model); }
