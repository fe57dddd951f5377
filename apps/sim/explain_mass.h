/* What --explain says of mass scaling. */
#ifndef TM_EXPLAIN_MASS_H
#define TM_EXPLAIN_MASS_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* How much mass was added, where, and what that does to the lowest frequencies; nothing where the scene has none, but
 * what a sliver costs where tissue is cut. */
void explain_mass(const sim *s, cJSON *json);

#endif
