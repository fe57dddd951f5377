/* Public API (tensormass_scene.h) of sim.h. */
#include "tensormass_scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim.h"
#include "snapshot.h"

struct tm_scene {
    sim *s;
    char **set; /* the scene's lines point into it */
    int set_count;
};

enum { COOKIE = 0x5ce4e };

/* Checks the caller's arguments as TM_REQUIRE of the core library does, through its public function. */
#define REQUIRE(condition, sentence, ...)                                                                              \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            tm_contract_broken(__func__, sentence);                                                                    \
            return __VA_ARGS__;                                                                                        \
        }                                                                                                              \
    } while (0)
#define REQUIRE_SCENE(...) REQUIRE(scene, "scene is null", __VA_ARGS__)
#define REQUIRE_INSTRUMENT(...)                                                                                        \
    REQUIRE(scene &&instrument >= 0 && instrument < scene->s->instrument_count,                                        \
            "scene is null or instrument is not one of its own", __VA_ARGS__)

static const char *const model_name[] = {"dynamic", "precomputed", "hybrid"};

tm_scene_def tm_scene_def_default(void) { return (tm_scene_def){.cookie = COOKIE, .size = sizeof(tm_scene_def)}; }

/* --- the scene --- */

/* Copies the lines of `set`. Returns null if memory is exhausted. */
static tm_scene *begin(const tm_scene_def *def) {
    tm_scene *made = calloc(1, sizeof *made);
    if (made) made->set = calloc((size_t)def->set_count + 1, sizeof *made->set);
    bool kept = made && made->set;
    for (int32_t i = 0; i < def->set_count && kept; i++)
        kept = (made->set[made->set_count++] = strdup(def->set[i])) != NULL;
    if (kept) return made;
    tm_scene_close(made);
    return NULL;
}

static tm_status build(tm_scene *made, const tm_scene_def *def, const app_host *host) {
    app_scene *read = NULL;
    const tm_status status = sim_scene_load(def->file, made->set, made->set_count, host, &read);
    if (status) return status;
    read->strict = def->strict;
    if (!read->renumber.line) read->renumber.on = false; /* callers read the memory itself */
    return sim_create(read, &made->s);
}

tm_status tm_scene_open(const tm_scene_def *def, tm_scene **scene) {
    const bool filled = def && def->cookie == COOKIE && def->size == sizeof *def;
    if (!scene || !filled || !def->file || def->set_count < 0 || (def->set_count && !def->set)) {
        tm_contract_broken("tm_scene_open", !filled ? "def was not filled by tm_scene_def_default"
                                                    : "scene, def->file or def->set is null");
        return TM_ERR_ARGUMENT;
    }
    *scene = NULL;
    const app_host host = {
        .diagnostics = def->diagnostics, .progress = def->progress, .stop = def->stop, .user = def->user};
    tm_scene *made = begin(def);
    if (!made) return app_scene_no_memory(&host, def->file);
    const tm_status status = build(made, def, &host);
    if (status) {
        made->s = NULL;
        tm_scene_close(made);
        return status;
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

tm_scene_info tm_scene_get_info(const tm_scene *scene) {
    REQUIRE_SCENE((tm_scene_info){.title = "", .model = ""});
    const sim *s = scene->s;
    return (tm_scene_info){.title = s->scene->title.s,
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
    REQUIRE_SCENE(TM_ERR_ARGUMENT);
    sim *s = scene->s;
    tm_tool_pose hand[TM_MAX_INSTRUMENTS] = {0};
    /* Rounded to microseconds, as tm-sim's clock: the same bits. */
    double end_s = (double)llround((double)(s->frames + 1) * s->frame_s * 1e6) * 1e-6;
    for (int i = 0; i < s->instrument_count && !to; i++) hand[i] = sim_hand_pose(s, i, end_s);
    return sim_frame(s, to ? to : hand, s->substeps);
}

tm_tool_pose tm_scene_pose_of(const tm_scene *scene, int32_t instrument, const double joint[7], bool active) {
    REQUIRE_INSTRUMENT((tm_tool_pose){0});
    REQUIRE(joint, "joint is null", (tm_tool_pose){0});
    return sim_pose(scene->s, instrument, joint, active);
}

int32_t tm_scene_get_bodies(const tm_scene *scene, tm_scene_body *body, int32_t capacity) {
    REQUIRE(scene && (body || capacity <= 0), "scene or body is null", 0);
    for (int32_t i = 0; i < scene->s->body_count && i < capacity; i++) {
        const sim_body *b = scene->s->body + i;
        body[i] = (tm_scene_body){b->name, b->vertex_begin, b->vertex_end, b->tet_begin, b->tet_end, b->rigid};
    }
    return scene->s->body_count;
}

tm_mesh *tm_scene_mesh(tm_scene *scene) {
    REQUIRE_SCENE(NULL);
    return scene->s->mesh;
}

tm_tissue *tm_scene_tissue(tm_scene *scene) {
    REQUIRE_SCENE(NULL);
    return scene->s->model->tissue;
}

tm_world *tm_scene_world(tm_scene *scene) {
    REQUIRE_SCENE(NULL);
    return scene->s->model->world;
}

tm_contact *tm_scene_contact(tm_scene *scene) {
    REQUIRE_SCENE(NULL);
    return scene->s->model->contact;
}

tm_surface_view tm_scene_surface(const tm_scene *scene) {
    REQUIRE_SCENE((tm_surface_view){0});
    return sim_surface(scene->s);
}

const double *tm_scene_displacement(const tm_scene *scene) {
    REQUIRE_SCENE(NULL);
    return sim_displacement(scene->s);
}

tm_tool_reaction tm_scene_reaction(const tm_scene *scene, int32_t instrument) {
    REQUIRE_INSTRUMENT((tm_tool_reaction){0});
    return scene->s->reaction[instrument];
}

tm_tool_pose tm_scene_pose(const tm_scene *scene, int32_t instrument) {
    REQUIRE_INSTRUMENT((tm_tool_pose){0});
    return scene->s->pose[instrument];
}

tm_instrument_def tm_scene_instrument(const tm_scene *scene, int32_t instrument) {
    REQUIRE_INSTRUMENT((tm_instrument_def){0});
    return scene->s->instrument_def[instrument];
}

uint64_t tm_scene_hash(const tm_scene *scene) {
    REQUIRE_SCENE(0);
    return sim_hash(scene->s);
}

const tm_patch *tm_scene_patch(const tm_scene *scene, int32_t instrument) {
    REQUIRE_INSTRUMENT(NULL);
    return scene->s->patch && scene->s->patch_valid[instrument] ? &scene->s->patch[instrument] : NULL;
}

tm_status tm_scene_save(tm_scene *scene, const char *path) {
    REQUIRE(scene && path, "scene or path is null", TM_ERR_ARGUMENT);
    return sim_snapshot_save(scene->s, path);
}

tm_status tm_scene_restore(tm_scene *scene, const char *path) {
    REQUIRE(scene && path, "scene or path is null", TM_ERR_ARGUMENT);
    sim *s = scene->s;
    const tm_status status = sim_snapshot_restore(s, path);
    if (status) return status;
    for (int i = 0; i < s->model->instrument_count; i++) s->reaction[i] = tm_model_reaction(s->model, i);
    memset(s->patch_valid, 0, sizeof s->patch_valid); /* the next frame computes new ones */
    return TM_OK;
}
