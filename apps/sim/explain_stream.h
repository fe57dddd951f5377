/* Rate of force samples in the output of --explain. */
#ifndef TM_EXPLAIN_STREAM_H
#define TM_EXPLAIN_STREAM_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* Reports the rate, the substeps per sample and the contents of a sample; nothing without `haptics`. */
void explain_stream(const sim *s, cJSON *json);

#endif
