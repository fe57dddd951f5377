/* Grasping: instruments in grasper mode hold tissue between their jaws. Requires the stage "contact". */
#ifndef TENSORMASS_GRASP_H
#define TENSORMASS_GRASP_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tm_grasp_def {
    uint32_t cookie, size;
    /* A grip rising to close_grip (0.7) closes the jaws, falling to open_grip (0.3) opens them; between the two they
     * keep their state. */
    double close_grip, open_grip;
    double jaw_length_m;   /* length of axis behind the tip that grasps, 0.01 */
    double reach_m;        /* added to the tool's radius: vertices of triangles within it are grasped, 0.001 */
    double compliance_m_N; /* of the spring on each vertex, per axis, 0.2e-3 */
    /* After opening, the force limit of each spring falls linearly to zero within this time, 0.1. */
    double release_time_s;
    double force_cap_N;   /* maximum force per vertex, 20; beyond it the vertex slips */
    int32_t max_vertices; /* per instrument, 64; the nearest are kept */
} tm_grasp_def;

typedef enum tm_grasp_state { TM_GRASP_OPEN = 0, TM_GRASP_HOLDING = 1, TM_GRASP_RELEASING = 2 } tm_grasp_state;

typedef struct tm_grasp tm_grasp;

TM_API tm_grasp_def tm_grasp_def_default(void);
/* Adds the stage "grasp"; `contact` is the world's. tm_contact_reaction of the instrument includes its forces. The
 * world owns the handle. */
TM_API tm_status tm_stage_grasp(tm_world *world, tm_contact *contact, const tm_grasp_def *def, tm_grasp **grasp,
                                tm_error *error);
/* Returns the number of vertices that an instrument holds or is releasing; `*vertex` may be null. A vertex whose last
 * tetrahedron was removed is not held. */
TM_API int32_t tm_grasp_vertices(const tm_grasp *grasp, int32_t instrument, const int32_t **vertex,
                                 tm_grasp_state *state);

/* --- geometry: shared with the precomputed model --- */

typedef struct tm_jaw {
    double origin[3];    /* direction of the shaft at roll 0 */
    double axis_m[3][3]; /* axes of the tool's frame: two across the shaft, one along it */
} tm_jaw;
/* Sets the origin of roll to the shaft's direction now. */
TM_API void tm_jaw_begin(tm_jaw *jaw, const tm_instrument_def *tool, const tm_tool_pose *pose);
TM_API void tm_jaw_rotate(tm_jaw *jaw, const tm_instrument_def *tool, const tm_tool_pose *pose);
TM_API void tm_jaw_to_tool(const tm_jaw *jaw, const tm_tool_pose *pose, const double at_m[3], double offset_m[3]);
TM_API void tm_jaw_to_world(const tm_jaw *jaw, const tm_tool_pose *pose, const double offset_m[3], double at_m[3]);
/* Writes the surface vertices that the jaws close on (at most def->max_vertices, ascending). distance_m [max_vertices]
 * is scratch memory. Returns the count. */
TM_API int32_t tm_jaw_capture(const tm_jaw *jaw, const tm_grasp_def *def, const tm_instrument_def *tool,
                              const tm_tool_pose *pose, const double *rest_m, const double *u_m,
                              const tm_surface_view *surface, int32_t *vertex, double *distance_m);

#ifdef __cplusplus
}
#endif
#endif
