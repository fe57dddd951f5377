/* What a run notes on its way and says at its end: tools that never touched, tissue deformed too far. */
#ifndef TM_SIM_OBSERVE_H
#define TM_SIM_OBSERVE_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* After a frame: how near each instrument that has not touched yet has come. */
void sim_reach_note(sim *s);
/* At the end of a run of this length: a warning for each that never touched, if the run was long enough to. */
void sim_reach_report(const sim *s, double seconds);

/* After a frame, some of them: how far the tissue is deformed, where all of it is known (the dynamic model). */
void sim_shape_note(sim *s);
/* At the end of a run: in the report (null: none), and a warning if it was linear and far outside its range. */
void sim_shape_report(const sim *s, cJSON *report);
/* The same of one shape. */
/* Tells how many tetrahedra were beyond a limit of their nonlinear law, in the report and, above 1 %, as a warning. */
void sim_limit_report(const sim *s, int32_t tets, const char *when, cJSON *report);
void sim_shape_warn(const sim *s, const tm_deformation *shape, const char *when);
void sim_shape_json(const tm_deformation *shape, cJSON *report);

#endif
