/* Observations during a run, reported at its end: tools that never touched, tissue deformed too far. */
#ifndef TM_SIM_OBSERVE_H
#define TM_SIM_OBSERVE_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* Records, after a frame, the smallest distance of each instrument that has not touched yet. */
void sim_reach_note(sim *s);
/* Warns, at the end of a run, about each instrument that never touched, if `seconds` was long enough for it. */
void sim_reach_report(const sim *s, double seconds);

/* Records, after some frames, the deformation of the tissue where all of it is known (the dynamic model). */
void sim_shape_note(sim *s);
/* Adds the deformation to the report (null: none) at the end of a run. Warns if the run was linear and far outside its
 * range. */
void sim_shape_report(const sim *s, cJSON *report);
/* Reports how many tetrahedra were beyond a limit of their nonlinear law; warns above 1 %. */
void sim_limit_report(const sim *s, int32_t tets, const char *when, cJSON *report);
/* Reports in which share of the volume a nonlinear law is not elliptic; warns above 0.5 %. */
void sim_unstable_report(const sim *s, double share, const char *when, cJSON *report);
/* Warns, and reports, about one shape. */
void sim_shape_warn(const sim *s, const tm_deformation *shape, const char *when);
void sim_shape_json(const tm_deformation *shape, cJSON *report);

#endif
