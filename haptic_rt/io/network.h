/* Loads the module that links LCM (lcm_types/link.h), when messages are needed. */
#ifndef HRT_NETWORK_H
#define HRT_NETWORK_H

#include "link.h"
#include "tensormass/base.h"

/* Returns null, with the package to install in `error`, if the module is missing. */
app_network_opener *hrt_network(tm_error *error);

#endif
