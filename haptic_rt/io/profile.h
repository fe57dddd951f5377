/* Reads and writes a device's profile and the controller's parameters as `name = value ...`. Names, units and ranges:
 * core/params.c. */
#ifndef HRT_PROFILE_H
#define HRT_PROFILE_H

#include <stdio.h>

#include "hrt.h"

/* Sets the parameters that the file names. Returns false after a message on stderr. */
bool hrt_profile_read(const char *path, hrt_params *params);
/* Sets one "name=value[,value...]", as on a command line. */
bool hrt_profile_set(const char *text, hrt_params *params);
/* Writes all parameters with unit, range and meaning, in the file's own format. */
void hrt_profile_write(FILE *file, const hrt_params *params);

#endif
