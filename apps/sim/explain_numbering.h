/* What --explain says of a mesh whose numbers jump. */
#ifndef TM_EXPLAIN_NUMBERING_H
#define TM_EXPLAIN_NUMBERING_H

#include <cjson/cJSON.h>

#include "sim.h"

/* How far apart neighbours' numbers are, and could be; printed only where it is worth renumbering. */
void explain_numbering(const sim *s, cJSON *json);

#endif
