/* Scenes: reads, builds and steps the YAML files of docs/scene-reference.md, frame by frame. Link with
 * -ltensormass_scene -ltensormass; docs/scene-guide.md shows a program. No function prints, exits or waits for a
 * signal: an error is a status and a list of diagnostics with file and line. World, mesh and tissue of a scene are
 * those of the core library (tensormass.h). Only one thread at a time may use a scene. */
#ifndef TENSORMASS_SCENE_H
#define TENSORMASS_SCENE_H

#include "tensormass.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- diagnostics --- */

typedef enum tm_severity {
    TM_REMARK = 0,  /* what was done, such as a model that was recomputed */
    TM_WARNING = 1, /* valid, but probably a mistake */
    TM_FAULT = 2    /* cause of the call's failure */
} tm_severity;

typedef struct tm_diagnostic {
    tm_severity severity;
    tm_status status;   /* of a fault, or of a warning that counts as one (tm_scene_def.strict); else TM_OK */
    int32_t line;       /* from 1; 0: no particular line */
    const char *file;   /* "liver.yaml", or "--set time.step=1" of tm_scene_def.set; "": none */
    const char *what;   /* never null */
    const char *remedy; /* what to do; "": unknown */
} tm_diagnostic;

/* Maximum length of a list. Once it is full, a fault replaces the last item that is not a fault; other items are
 * lost. */
enum { TM_DIAGNOSTICS_MAX = 256 };

/* A list that the caller owns; zeroed, it is empty. Calls append to it. Strings are valid as long as their item. */
typedef struct tm_diagnostics {
    tm_diagnostic *item; /* [count] in order of arrival */
    int32_t count, capacity;
    int32_t lost; /* items without memory or capacity (TM_DIAGNOSTICS_MAX) */
    /* Called at once for each diagnostic, lost ones included; its strings are valid during the call. May be null. */
    void (*on_diagnostic)(void *user, const tm_diagnostic *diagnostic);
    void *user;
} tm_diagnostics;

/* Empties the list and frees its memory; keeps `on_diagnostic` and `user`. */
TM_API void tm_diagnostics_clear(tm_diagnostics *list);
/* Writes "file:line: what; what to do" into `text`, truncated to `size`. A warning has "warning: " after its place.
 * Returns the full length, as snprintf does. */
TM_API int32_t tm_diagnostic_format(const tm_diagnostic *diagnostic, char *text, size_t size);

/* --- scenes --- */

typedef struct tm_scene tm_scene;

typedef struct tm_scene_def {
    uint32_t cookie, size; /* both set by tm_scene_def_default */
    const char *file;
    /* [set_count] "path=value" replaces a value of the scene, "path" removes a key. Relative paths in them start from
     * the working directory, not from the scene's folder. */
    const char *const *set;
    int32_t set_count;
    bool strict;                 /* treat warnings as faults */
    tm_diagnostics *diagnostics; /* must outlive the scene; null: a failure gives only a status */
    /* Called while a precomputed or hybrid model is computed: what is computed, the share done, seconds left (below 0:
     * unknown). Returns false to stop it. May be null. */
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    /* Called about ten times a second within tm_scene_step; returns true to abort the frame. The call then returns
     * TM_OK and tm_scene_info.frames stays the same: restore a snapshot, or close the scene. May be null. */
    bool (*stop)(void *user);
    void *user;
} tm_scene_def;
TM_API tm_scene_def tm_scene_def_default(void);

typedef struct tm_scene_info {
    const char *title, *model; /* valid as long as the scene */
    int32_t vertex_count, tet_count, alive_count, instrument_count;
    int32_t substeps;     /* per frame */
    double frame_s, dt_s; /* duration of a frame, of a substep */
    double duration_s;    /* requested by the scene */
    double time_s;        /* simulated */
    int64_t frames;
} tm_scene_info;

/* Reads, checks and builds a scene. Vertices keep the numbers of the mesh file unless the scene or `set` has
 * tissue.renumber. Then all functions below use the mesh's numbering (tm_mesh_original_vertex). Returns TM_ERR_ARGUMENT
 * for an error in the scene, TM_ERR_MEMORY, or another status of the libraries; *scene is then null. Precomputed and
 * hybrid models, and exact compliance for patches, open libtensormass_solve. */
TM_API tm_status tm_scene_open(const tm_scene_def *def, tm_scene **scene);
TM_API void tm_scene_close(tm_scene *scene); /* null: does nothing */

TM_API tm_scene_info tm_scene_get_info(const tm_scene *scene);
/* Computes one frame. Instruments move to `to` [instrument_count], or along the scene's hands (null). Returns
 * TM_ERR_UNSTABLE, without a diagnostic, if a displacement is no longer finite; the frame is then undone. */
TM_API tm_status tm_scene_step(tm_scene *scene, const tm_tool_pose *to);
/* Returns the pose in the world of an instrument with these joints of its device (seven entries; joints that the device
 * lacks are 0; docs/controller.md). */
TM_API tm_tool_pose tm_scene_pose_of(const tm_scene *scene, int32_t instrument, const double joint[7], bool active);

/* One of the bodies of a scene: a range [begin, end) of vertices and of tetrahedra. Vertices have the numbers of the
 * files, one body's after the other's (tm_mesh_original_vertex). */
typedef struct tm_scene_body {
    const char *name; /* valid as long as the scene */
    int32_t vertex_begin, vertex_end, tet_begin, tet_end;
    bool rigid;
} tm_scene_body;
/* Returns the number of bodies, 0 for a scene with tissue.mesh, and writes up to `capacity` of them. */
TM_API int32_t tm_scene_get_bodies(const tm_scene *scene, tm_scene_body *body, int32_t capacity);

TM_API tm_mesh *tm_scene_mesh(tm_scene *scene);
TM_API tm_tissue *tm_scene_tissue(tm_scene *scene);
TM_API tm_world *tm_scene_world(tm_scene *scene); /* null for the precomputed model */
/* Returns the contact of that world, for tm_contact_rows; null: no instruments, or the precomputed model. */
TM_API tm_contact *tm_scene_contact(tm_scene *scene);
TM_API tm_surface_view tm_scene_surface(const tm_scene *scene);
TM_API const double *tm_scene_displacement(const tm_scene *scene); /* [3*vertex_count] m */
TM_API tm_tool_reaction tm_scene_reaction(const tm_scene *scene, int32_t instrument);
TM_API tm_tool_pose tm_scene_pose(const tm_scene *scene, int32_t instrument);
TM_API tm_instrument_def tm_scene_instrument(const tm_scene *scene, int32_t instrument);
/* Returns the patch of the last frame; null: the scene sends none, or no tissue is near. */
TM_API const tm_patch *tm_scene_patch(const tm_scene *scene, int32_t instrument);
/* Returns a hash of the complete state: equal bits give equal hashes. */
TM_API uint64_t tm_scene_hash(const tm_scene *scene);
/* Write and read the files of tm-sim --snapshot. A damaged file, or one of another scene, is refused and changes
 * nothing. After tm_scene_restore the reactions are those of the snapshot; there is no patch until the next frame. */
TM_API tm_status tm_scene_save(tm_scene *scene, const char *path);
TM_API tm_status tm_scene_restore(tm_scene *scene, const char *path);

#ifdef __cplusplus
}
#endif
#endif
