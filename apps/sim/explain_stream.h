/* What --explain says of the rate of force samples. */
#ifndef TM_EXPLAIN_STREAM_H
#define TM_EXPLAIN_STREAM_H

#include <cjson/cJSON.h>

#include "scene/sim.h"

/* Rate, substeps of a sample, and what goes with it; nothing without `haptics`. */
void explain_stream(const sim *s, cJSON *json);

#endif
