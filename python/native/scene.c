/* libtensormass/scene behind the few functions of scene.h. */
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "said.h"
#include "scene/sim.h"
#include "scene/snapshot.h"

struct tm_scene {
    sim *s;
    char **set; /* the scene's lines point into it */
    int set_count;
};

static const char *const model_name[] = {"dynamic", "precomputed", "hybrid"};

/* --- the scene --- */

tm_status tm_scene_open(const char *file, const char *const *set, int32_t set_count, tm_scene **scene) {
    app_scene *read = NULL;
    said_begin();
    app_be_quiet();
    tm_scene *made = calloc(1, sizeof *made);
    if (made) made->set = calloc((size_t)set_count + 1, sizeof *made->set);
    bool kept = made && made->set;
    for (int32_t i = 0; i < set_count && kept; i++) kept = (made->set[made->set_count++] = strdup(set[i])) != NULL;
    if (!kept) {
        tm_scene_close(made);
        return TM_ERR_MEMORY;
    }
    int rc = sim_scene_load(file, made->set, made->set_count, &read);
    if (!rc && !read->renumber.line) read->renumber.on = false; /* what is looked at here is the memory itself */
    if (!rc) rc = sim_create(read, &made->s);
    if (rc) {
        made->s = NULL;
        tm_scene_close(made);
        return said_status(rc, TM_ERR_ARGUMENT);
    }
    for (int i = 0; i < made->s->instrument_count; i++) made->s->wants[i] = made->s->can_send;
    *scene = made;
    return TM_OK;
}

void tm_scene_close(tm_scene *scene) {
    if (!scene) return;
    sim_destroy(scene->s);
    for (int i = 0; i < scene->set_count; i++) free(scene->set[i]);
    free(scene->set);
    free(scene);
}

tm_scene_about tm_scene_tell(const tm_scene *scene) {
    const sim *s = scene->s;
    return (tm_scene_about){.title = s->scene->title.s,
                            .model = model_name[s->scene->model.index],
                            .vertex_count = s->mesh->vertex_count,
                            .tet_count = s->mesh->tet_count,
                            .alive_count = sim_alive(s),
                            .instrument_count = s->instrument_count,
                            .substeps = s->substeps,
                            .frame_s = s->frame_s,
                            .dt_s = s->dt_s,
                            .duration_s = s->scene->duration.si,
                            .time_s = sim_time_s(s),
                            .frames = s->frames};
}

tm_status tm_scene_step(tm_scene *scene, const tm_tool_pose *to) {
    sim *s = scene->s;
    tm_tool_pose hand[TM_MAX_INSTRUMENTS] = {0};
    said_begin();
    /* On the microsecond, as tm-sim's clock is: the same bits. */
    double end_s = (double)llround((double)(s->frames + 1) * s->frame_s * 1e6) * 1e-6;
    for (int i = 0; i < s->instrument_count && !to; i++) hand[i] = sim_hand_pose(s, i, end_s);
    return sim_frame(s, to ? to : hand, s->substeps);
}

tm_tool_pose tm_scene_pose_of(const tm_scene *scene, int32_t instrument, const double joint[5], bool active) {
    return sim_pose(scene->s, instrument, joint, active);
}

tm_mesh *tm_scene_mesh(tm_scene *scene) { return scene->s->mesh; }
tm_tissue *tm_scene_tissue(tm_scene *scene) { return scene->s->model->tissue; }
tm_world *tm_scene_world(tm_scene *scene) { return scene->s->model->world; }
tm_surface_view tm_scene_surface(const tm_scene *scene) { return sim_surface(scene->s); }
const double *tm_scene_displacement(const tm_scene *scene) { return sim_displacement(scene->s); }
tm_tool_reaction tm_scene_reaction(const tm_scene *scene, int32_t instrument) { return scene->s->reaction[instrument]; }
tm_tool_pose tm_scene_pose(const tm_scene *scene, int32_t instrument) { return scene->s->pose[instrument]; }
tm_instrument_def tm_scene_instrument(const tm_scene *scene, int32_t instrument) {
    return scene->s->instrument_def[instrument];
}
uint64_t tm_scene_hash(const tm_scene *scene) { return sim_hash(scene->s); }

const tm_patch *tm_scene_patch(const tm_scene *scene, int32_t instrument) {
    return scene->s->patch && scene->s->patch_valid[instrument] ? &scene->s->patch[instrument] : NULL;
}

tm_status tm_scene_save(tm_scene *scene, const char *path) {
    said_begin();
    return said_status(sim_snapshot_save(scene->s, path), TM_ERR_FILE);
}

tm_status tm_scene_restore(tm_scene *scene, const char *path) {
    said_begin();
    return said_status(sim_snapshot_restore(scene->s, path), TM_ERR_FILE);
}
