/* A scene as one object, for those who have no program of their own: read, built, stepped frame by frame. Not
 * installed: the Python package's (libtensormass_scene.so). Its world, mesh and tissue are those of the core library.
 */
#ifndef TENSORMASS_SCENE_H
#define TENSORMASS_SCENE_H

#include "tensormass.h"

typedef struct tm_scene tm_scene;

typedef struct tm_scene_about {
    const char *title, *model; /* valid while the scene is there */
    int32_t vertex_count, tet_count, alive_count, instrument_count;
    int32_t substeps;     /* of a frame */
    double frame_s, dt_s; /* of a frame, of a substep */
    double duration_s;    /* that the scene asks for */
    double time_s;        /* simulated */
    int64_t frames;
} tm_scene_about;

/* `set`: "path=value" laid over the scene, or "path" to leave a key out. What the reader has to say, warnings too, is
 * in tm_scene_said, a line each. Vertices keep the numbers of the mesh file unless the scene itself, or `set`, says
 * tissue.renumber: then all below is in the mesh's (tm_mesh_given). */
TM_API tm_status tm_scene_open(const char *file, const char *const *set, int32_t set_count, tm_scene **scene);
TM_API void tm_scene_close(tm_scene *scene); /* null: nothing */
/* Of this thread's last call, "" if nothing: "file:line: what; what to do". Valid until its next call. */
TM_API const char *tm_scene_said(void);

TM_API tm_scene_about tm_scene_tell(const tm_scene *scene);
/* One frame: instruments go to `to` [instrument_count], or where the scene's hands want them (null). */
TM_API tm_status tm_scene_step(tm_scene *scene, const tm_tool_pose *to);
/* Joints (pitch rad, yaw rad, insertion m, roll rad, grip 0..1) of an instrument's device as a pose in the world. */
TM_API tm_tool_pose tm_scene_pose_of(const tm_scene *scene, int32_t instrument, const double joint[5], bool active);

TM_API tm_mesh *tm_scene_mesh(tm_scene *scene);
TM_API tm_tissue *tm_scene_tissue(tm_scene *scene);
TM_API tm_world *tm_scene_world(tm_scene *scene); /* null: the precomputed model has none */
TM_API tm_surface_view tm_scene_surface(const tm_scene *scene);
TM_API const double *tm_scene_displacement(const tm_scene *scene); /* [3*vertex_count] m */
TM_API tm_tool_reaction tm_scene_reaction(const tm_scene *scene, int32_t instrument);
TM_API tm_tool_pose tm_scene_pose(const tm_scene *scene, int32_t instrument);
TM_API tm_instrument_def tm_scene_instrument(const tm_scene *scene, int32_t instrument);
/* Of the last frame; null: the scene sends none, or nothing is near. */
TM_API const tm_patch *tm_scene_patch(const tm_scene *scene, int32_t instrument);
TM_API uint64_t tm_scene_hash(const tm_scene *scene);
/* The files of tm-sim --snapshot. */
TM_API tm_status tm_scene_save(tm_scene *scene, const char *path);
TM_API tm_status tm_scene_restore(tm_scene *scene, const char *path);

#endif
