/* What --explain says of a mesh whose numbers jump. */
#ifndef TM_EXPLAIN_NUMBERING_H
#define TM_EXPLAIN_NUMBERING_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* How far apart neighbours' numbers are in the file, and in the best order; printed only where that is worth having. */
void explain_numbering(const sim *s, cJSON *json);

#endif
