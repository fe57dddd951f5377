/* Mass scaling in the output of --explain. */
#ifndef TM_EXPLAIN_MASS_H
#define TM_EXPLAIN_MASS_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* Reports the added mass, its distribution and its effect on the lowest frequencies. Without mass scaling, reports only
 * the cost of a sliver, and only if tissue is cut. */
void explain_mass(const sim *s, cJSON *json);

#endif
