/* The door to the module that links LCM (lcm_types/link.h); opened when messages are wanted. */
#ifndef HRT_NETWORK_H
#define HRT_NETWORK_H

#include "link.h"
#include "tensormass/base.h"

/* Null, with the package to install, when it is not there. */
app_network_opener *hrt_network(tm_error *error);

#endif
