/* Scenes: the YAML files of docs/scene-reference.md, read, built and stepped frame by frame. Link with
 * -ltensormass_scene -ltensormass; docs/scene-guide.md shows a program. Nothing here prints, exits or waits for a
 * signal: what is wrong is a status and a list of diagnostics with file and line. World, mesh and tissue of a scene are
 * those of the core library (tensormass.h). One thread at a time may use a scene. */
#ifndef TENSORMASS_SCENE_H
#define TENSORMASS_SCENE_H

#include "tensormass.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- diagnostics --- */

typedef enum tm_severity {
    TM_REMARK = 0,  /* what was done, such as a model computed anew */
    TM_WARNING = 1, /* valid, and probably not meant */
    TM_FAULT = 2    /* the call failed, for this */
} tm_severity;

typedef struct tm_diagnostic {
    tm_severity severity;
    tm_status status;   /* of a fault, or of a warning that is one (tm_scene_def.strict); else TM_OK */
    int32_t line;       /* from 1; 0: none in particular */
    const char *file;   /* "liver.yaml", or "--set time.step=1" of tm_scene_def.set; "": none */
    const char *what;   /* never null */
    const char *remedy; /* what to do; "": nothing is known */
} tm_diagnostic;

/* Most that a list keeps. Past it a fault takes the place of the last item that is none; anything else is lost. */
enum { TM_DIAGNOSTICS_MAX = 256 };

/* A list that the caller owns: zeroed, it is empty. Calls add to it; strings live as long as their item. */
typedef struct tm_diagnostics {
    tm_diagnostic *item; /* [count] in the order in which they came */
    int32_t count, capacity;
    int32_t lost; /* that there was no memory for, or no place (TM_DIAGNOSTICS_MAX) */
    /* Called at once with each, also with those that are lost; its strings are valid during the call. May be null. */
    void (*on_diagnostic)(void *user, const tm_diagnostic *diagnostic);
    void *user;
} tm_diagnostics;

/* Empties the list and frees its memory; `told` and `user` stay. */
TM_API void tm_diagnostics_clear(tm_diagnostics *list);
/* "file:line: what; what to do" into `text`, cut to `size`; a warning begins with "warning: " after its place. Returns
 * the length of all of it, as snprintf does. */
TM_API int32_t tm_diagnostic_format(const tm_diagnostic *diagnostic, char *text, size_t size);

/* --- scenes --- */

typedef struct tm_scene tm_scene;

typedef struct tm_scene_def {
    uint32_t cookie, size; /* both set by tm_scene_def_default */
    const char *file;
    /* [set_count] "path=value" laid over the scene, or "path" to leave a key out. Relative paths in them are the
     * caller's, not the scene's. */
    const char *const *set;
    int32_t set_count;
    bool strict;                 /* a warning is a fault */
    tm_diagnostics *diagnostics; /* outlives the scene; null: what is wrong is a status alone */
    /* While a precomputed or hybrid model is computed: what, the share that is done, seconds left (below 0: not known).
     * False stops it. May be null. */
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    /* Asked some ten times a second within tm_scene_step: true breaks the frame off. The call then returns TM_OK, and
     * tm_scene_info.frames has not grown: restore a snapshot, or close the scene. May be null. */
    bool (*stop)(void *user);
    void *user;
} tm_scene_def;
TM_API tm_scene_def tm_scene_def_default(void);

typedef struct tm_scene_info {
    const char *title, *model; /* valid while the scene is there */
    int32_t vertex_count, tet_count, alive_count, instrument_count;
    int32_t substeps;     /* of a frame */
    double frame_s, dt_s; /* of a frame, of a substep */
    double duration_s;    /* that the scene asks for */
    double time_s;        /* simulated */
    int64_t frames;
} tm_scene_info;

/* Reads, checks and builds a scene. Vertices keep the numbers of the mesh file unless the scene itself, or `set`, says
 * tissue.renumber: then all below is in the mesh's (tm_mesh_original_vertex). TM_ERR_ARGUMENT: something in the scene
 * is wrong; TM_ERR_MEMORY; any other status of the libraries. On failure *scene is null. Precomputed and hybrid models,
 * and exact compliance for patches, open libtensormass_solve. */
TM_API tm_status tm_scene_open(const tm_scene_def *def, tm_scene **scene);
TM_API void tm_scene_close(tm_scene *scene); /* null: nothing */

TM_API tm_scene_info tm_scene_get_info(const tm_scene *scene);
/* One frame: instruments go to `to` [instrument_count], or where the scene's hands want them (null). TM_ERR_UNSTABLE,
 * without a diagnostic: a displacement stopped being finite, and the frame has not happened. */
TM_API tm_status tm_scene_step(tm_scene *scene, const tm_tool_pose *to);
/* Joints of an instrument's device (room for seven, those that it has not are 0; docs/controller.md) as a pose in the
 * world. */
TM_API tm_tool_pose tm_scene_pose_of(const tm_scene *scene, int32_t instrument, const double joint[7], bool active);

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
/* Of the whole state: the same bits, the same hash. */
TM_API uint64_t tm_scene_hash(const tm_scene *scene);
/* The files of tm-sim --snapshot. A damaged file, or another scene's, is refused and changes nothing. After
 * tm_scene_restore reactions are those of the snapshot, and there is no patch until the next frame. */
TM_API tm_status tm_scene_save(tm_scene *scene, const char *path);
TM_API tm_status tm_scene_restore(tm_scene *scene, const char *path);

#ifdef __cplusplus
}
#endif
#endif
