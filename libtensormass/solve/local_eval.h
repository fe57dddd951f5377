/* Between local.c and newton.c. */
#ifndef TMS_LOCAL_EVAL_H
#define TMS_LOCAL_EVAL_H

#include "local.h"

/* u at the slots from base and forces. */
void tms_local_shape(tms_local *local);
/* Rows of the shape in u_m, their forces on the slots and on the tools. */
void tms_local_look(tms_local *local, tms_look *look);

#endif
