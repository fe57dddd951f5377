/* Which line of the scene is to blame for a model that could not be made. */
#include "models.h"

#include <string.h>

/* The line of the scene that asked for a member of tm_model_def. */
static int line_of(const app_scene *scene, const char *member) {
    const struct {
        const char *member;
        int line;
    } row[] = {{"tissue", scene->tissue.line},
               {"support", scene->support.line},
               {"load", scene->load.line},
               {"precision", scene->precision.line},
               {"frame_s", scene->step.line ? scene->step.line : scene->material.line},
               {"step_s", scene->step.line}};
    for (size_t i = 0; member && i < sizeof row / sizeof *row; i++)
        if (!strcmp(row[i].member, member)) return row[i].line;
    const int effect = member ? sim_effect_find(scene, member) : -1;
    return effect >= 0 ? sim_effect_line(scene, effect) : scene->model.line;
}

tm_status sim_model_made(const sim *s, tm_status status, const tm_error *error) {
    const char *blame = s->def.blame ? s->def.blame : "";
    const int line = line_of(s->scene, blame);
    if (status == TM_OK) return TM_OK;
    if (!strcmp(blame, "precision"))
        return app_scene_bad(s->scene, line,
                             "tissue.precision = single, and %s, or take double: rounded tensors would set it turning",
                             error->message);
    if (s->scene->mass_scaling.on && !strcmp(blame, "tissue") && (status == TM_ERR_LIMIT || status == TM_ERR_EXCLUDED))
        return app_scene_bad(s->scene, s->scene->mass_scaling.line, "time.mass_scaling: %s (time.step, time.mass_most)",
                             error->message);
    if ((status == TM_ERR_STEP || status == TM_ERR_LIMIT) && error->entity >= 0)
        return app_scene_bad(s->scene, line, "%s (tetrahedron %lld of the mesh file; tm-mesh info)", error->message,
                             (long long)s->file.tet_tag[error->entity]);
    return sim_report(s->scene, line, error);
}
