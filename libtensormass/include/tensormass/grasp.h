/* Grasping: instruments in the mode grasper hold the tissue between their jaws. A stage of its own beside contact. */
#ifndef TENSORMASS_GRASP_H
#define TENSORMASS_GRASP_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tm_grasp_def {
    uint32_t cookie, size;
    double close_grip,
        open_grip; /* grip rising to 0.7 closes the jaw, falling to 0.3 opens it; between them it stays as it is */
    double jaw_length_m;   /* of the axis behind the tip that takes hold, 0.01 */
    double reach_m;        /* beyond the tool's radius: triangles that near are taken by their vertices, 0.001 */
    double compliance_m_N; /* of the hold on each vertex, per axis, 0.2e-3 */
    double release_time_s; /* after opening, what the spring on each vertex can bear falls evenly to nothing within this
                      time, 0.1 */
    double force_cap_N;    /* per vertex, 20; what is beyond slips */
    int32_t max_vertices;  /* per instrument, nearest kept, 64 */
} tm_grasp_def;

typedef enum tm_grasp_state { TM_GRASP_OPEN = 0, TM_GRASP_HOLDING = 1, TM_GRASP_RELEASING = 2 } tm_grasp_state;

typedef struct tm_grasp tm_grasp;

TM_API tm_grasp_def tm_grasp_def_default(void);
/* Adds the "grasp" stage; `contact` is the world's. Its forces are in tm_contact_reaction of the instrument. The world
 * owns the handle. */
TM_API tm_status tm_stage_grasp(tm_world *world, tm_contact *contact, const tm_grasp_def *def, tm_grasp **grasp,
                                tm_error *error);
/* Vertices held, or being let go, by an instrument; `*vertex` may be null. Vertices whose last tetrahedron was removed
 * are not held. */
TM_API int32_t tm_grasp_vertices(const tm_grasp *grasp, int32_t instrument, const int32_t **vertex,
                                 tm_grasp_state *state);

/* --- geometry alone: shared with the precomputed model --- */

typedef struct tm_jaw {
    double origin[3];    /* direction of the shaft that roll is counted from */
    double axis_m[3][3]; /* of the tool's frame: two across, one along the shaft */
} tm_jaw;
/* Counts roll from the shaft's direction now. */
TM_API void tm_jaw_begin(tm_jaw *jaw, const tm_instrument_def *tool, const tm_tool_pose *pose);
TM_API void tm_jaw_rotate(tm_jaw *jaw, const tm_instrument_def *tool, const tm_tool_pose *pose);
TM_API void tm_jaw_to_tool(const tm_jaw *jaw, const tm_tool_pose *pose, const double at_m[3], double offset_m[3]);
TM_API void tm_jaw_to_world(const tm_jaw *jaw, const tm_tool_pose *pose, const double offset_m[3], double at_m[3]);
/* Surface vertices (at most def->max_vertices, ascending) that the jaw closes upon; distance_m [max_vertices] is
 * scratch. Returns how many. */
TM_API int32_t tm_jaw_capture(const tm_jaw *jaw, const tm_grasp_def *def, const tm_instrument_def *tool,
                              const tm_tool_pose *pose, const double *rest_m, const double *u_m,
                              const tm_surface_view *surface, int32_t *vertex, double *distance_m);

#ifdef __cplusplus
}
#endif
#endif
