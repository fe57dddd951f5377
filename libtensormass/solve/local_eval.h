/* Between local.c and newton.c. */
#ifndef TMS_LOCAL_EVAL_H
#define TMS_LOCAL_EVAL_H

#include "local.h"

/* u at the slots from base and forces. */
void tms_local_shape(tms_local *local);
/* Rows of that shape, their forces on the slots (fc) and on the tools. */
void tms_local_rows(tms_local *local, tm_contact_row *row, int32_t *row_count);

#endif
