/* A device's profile and the controller's parameters from a file: `name = value ...`, names, units and ranges as in
 * core/params.c. */
#ifndef HRT_PROFILE_H
#define HRT_PROFILE_H

#include <stdio.h>

#include "hrt.h"

/* Changes what the file names, on top of what `params` holds. False with a message on stderr. */
bool hrt_profile_read(const char *path, hrt_params *params);
/* One "name=value[,value...]" as on a command line. */
bool hrt_profile_set(const char *text, hrt_params *params);
/* All parameters with unit, range and meaning, in the file's own form. */
void hrt_profile_write(FILE *file, const hrt_params *params);

#endif
