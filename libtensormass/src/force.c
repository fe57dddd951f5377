/* The plain force loop in both precisions. */
#include "kernel.h"

#define TM_REAL double
#define TM_NAME tm_force_plain_double
#include "force_kernel.h"
#undef TM_REAL
#undef TM_NAME

#define TM_REAL float
#define TM_NAME tm_force_plain_single
#include "force_kernel.h"
#undef TM_REAL
#undef TM_NAME
