/* Vertex numbering in the output of --explain. */
#ifndef TM_EXPLAIN_NUMBERING_H
#define TM_EXPLAIN_NUMBERING_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* Reports the bandwidth of the file's numbering and of the best order. Prints it only if renumbering is worthwhile. */
void explain_numbering(const sim *s, cJSON *json);

#endif
